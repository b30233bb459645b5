/** The worker that decodes, so that the page stays responsive. One worker decodes one file. */

import { Refusal } from "../container/refusal";
import { readIntact, type Stream } from "../container/stream";
import { Decoder } from "../decoder";
import { plyBytes } from "../formats/ply";
import type { Reply, Request, Summary } from "./messages";

let opened: Stream | null = null;
let proceed: () => void = () => undefined;

self.onmessage = async ({ data: request }: MessageEvent<Request>) => {
  try {
    if (request.kind === "open") open(request.data);
    else if (request.kind === "continue") proceed();
    else await decode(request);
  } catch (error) {
    if (error instanceof Refusal) reply({ kind: "refused", message: error.message, rule: error.rule });
    else reply({ kind: "failed", message: error instanceof Error ? error.message : String(error) });
  }
};

function open(data: Uint8Array): void {
  const { stream, damage } = readIntact(data);
  opened = stream;
  reply({ kind: "summary", summary: summaryOf(data.length, stream, damage) });
}

async function decode({ wasm, tables, model }: Extract<Request, { kind: "decode" }>): Promise<void> {
  if (!opened) throw new Error("no stream was opened.");
  const start = performance.now();
  const decoder = await Decoder.load(wasm, tables, model);
  reply({ kind: "ready", ms: performance.now() - start });
  for await (const { stage, gaussians, timings } of decoder.stages(opened)) {
    const ply = plyBytes(gaussians);
    const isShown = new Promise<void>((resolve) => (proceed = resolve));
    reply({ kind: "stage", stage, count: gaussians.count, ply, timings }, [ply.buffer]);
    await isShown; // decoding takes all of a processor core, which drawing may need
  }
  reply({ kind: "done" });
}

function summaryOf(bytes: number, { header, cameras, sections, payloads }: Stream, damage: string | null): Summary {
  return {
    bytes,
    version: `${header.major}.${header.minor}`,
    modelId: header.modelId,
    height: header.height,
    width: header.width,
    stages: payloads.length,
    parts: [["header", header.end], ...sections.map(({ name, offset, end }) => [name, end - offset] as [string, number])],
    cameras,
    damage,
  };
}

function reply(message: Reply, transfer: Transferable[] = []): void {
  (self as unknown as Worker).postMessage(message, transfer);
}
