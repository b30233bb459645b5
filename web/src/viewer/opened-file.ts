/** One opened file: its decoder worker, and what the page shows of it. */

import { Refusal } from "../container/refusal";
import { middleOf } from "./camera-path";
import type { Reply, Request, Summary } from "./messages";
import { element, Facts, markCamera, showCameras, showProblem, showStatus } from "./panel";
import type { SceneView } from "./scene-view";
import { drawThumbnails } from "./thumbnails";

const PREVIEW_MS = 5000; // a preview that takes longer to draw does not delay the next stage

/** A file that is being decoded and shown. Closing it stops its decoder. */
export class OpenedFile {
  /** Bytes of a .ply file of the last decoded stage, null before. */
  ply: Uint8Array<ArrayBuffer> | null = null;
  summary: Summary | null = null;
  private readonly facts = new Facts(element<HTMLTableElement>("facts"));
  private readonly opened = performance.now();

  /** worker: a new decoder worker, which this file then owns. */
  constructor(
    readonly name: string,
    data: Uint8Array,
    private readonly worker: Worker,
    private readonly view: SceneView,
  ) {
    showProblem("");
    showStatus(`${name}: reading`);
    this.worker.onmessage = ({ data: reply }: MessageEvent<Reply>) => void this.handle(reply).catch(this.fail);
    this.worker.onerror = (event) => this.fail(new Error(event.message || "the decoder could not be started."));
    this.request({ kind: "decode", data });
  }

  close(): void {
    this.worker.terminate();
    this.view.clear();
  }

  /** Move to a coded camera; indices without a camera are ignored. */
  goTo(index: number): void {
    const camera = this.summary?.cameras.views[index];
    if (!camera) return;
    markCamera(index);
    this.view.goTo(camera);
  }

  private async handle(reply: Reply): Promise<void> {
    if (reply.kind === "summary") this.start(reply.summary);
    else if (reply.kind === "ready") this.startDecoding(reply.ms);
    else if (reply.kind === "stage") await this.show(reply);
    else if (reply.kind === "done") this.finish();
    else this.fail(reply.kind === "refused" ? new Refusal(reply.rule, reply.message) : new Error(reply.message));
  }

  private start(summary: Summary): void {
    this.summary = summary;
    this.facts.addSummary(summary);
    const first = middleOf(summary.cameras.views);
    this.view.setCameras(summary.cameras, first);
    showCameras(summary.cameras.views.length, (index) => this.goTo(index));
    markCamera(first);
    if (summary.damage) showProblem(`${this.name}: ${summary.damage}`);
    showStatus(`${this.name}: loading the decoder`);
  }

  private startDecoding(waitedMs: number): void {
    this.facts.heading("Decoder");
    this.facts.addStep("wait for decoder and model", waitedMs);
    showStatus(`${this.name}: decoding`);
  }

  private async show({ stage, count, ply, timings }: Extract<Reply, { kind: "stage" }>): Promise<void> {
    this.ply = ply;
    const start = performance.now();
    await this.view.setGaussians(ply, "ply");
    await this.view.whenDrawn(PREVIEW_MS);
    this.request({ kind: "continue" });
    this.facts.addStage(stage, count, [...timings, { step: "draw", ms: performance.now() - start }]);
    const seconds = ((performance.now() - this.opened) / 1000).toFixed(2);
    showStatus(`${this.name}: stage ${stage} of ${this.summary?.stages}, ${count.toLocaleString("en")} Gaussians, ${seconds} s`);
    document.body.dataset.stage = String(stage);
    element("downloads").hidden = false;
  }

  private finish(): void {
    document.body.dataset.done = "true";
    this.worker.terminate(); // frees the memory of the networks
    if (!this.summary || !this.ply) return;
    const { cameras, width, height } = this.summary;
    void drawThumbnails(this.view, cameras, width, height);
  }

  private readonly fail = (error: unknown): void => {
    const message = error instanceof Error ? error.message : String(error);
    showProblem(`${this.name}: ${message}`);
    document.body.dataset.rule = error instanceof Refusal ? error.rule : "";
    if (this.ply === null) showStatus("This file could not be shown.");
    this.finish();
  };

  private request(message: Request): void {
    this.worker.postMessage(message);
  }
}
