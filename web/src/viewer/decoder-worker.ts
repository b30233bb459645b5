/**
 * The worker that decodes, so that the page stays responsive. One worker decodes one file. It loads the decoder and a
 * model when it starts, before there is a file.
 */

import { Refusal } from "../container/refusal";
import { readIntact, type Stream } from "../container/stream";
import { Decoder } from "../decoder";
import { plyBytes } from "../formats/ply";
import { fetchModel, fetchModelIds, fetchRuntime } from "./assets";
import type { Reply, Request, Summary } from "./messages";

interface Loaded {
  modelId: string;
  decoder: Decoder;
}

let proceed: () => void = () => undefined;
const runtime = fetchRuntime();
const ahead = loadAhead();
for (const promise of [runtime, ahead]) promise.catch(() => undefined); // reported when a file needs them

self.onmessage = async ({ data: request }: MessageEvent<Request>) => {
  if (request.kind === "continue") return proceed();
  try {
    await decode(request.data);
  } catch (error) {
    if (error instanceof Refusal) reply({ kind: "refused", message: error.message, rule: error.rule });
    else reply({ kind: "failed", message: error instanceof Error ? error.message : String(error) });
  }
};

async function decode(data: Uint8Array): Promise<void> {
  const { stream, damage } = readIntact(data);
  reply({ kind: "summary", summary: summaryOf(data.length, stream, damage) });
  const start = performance.now();
  const decoder = await decoderOf(stream.header.modelId);
  reply({ kind: "ready", ms: performance.now() - start });
  for await (const { stage, gaussians, timings } of decoder.stages(stream)) {
    const ply = plyBytes(gaussians);
    const isShown = new Promise<void>((resolve) => (proceed = resolve));
    reply({ kind: "stage", stage, count: gaussians.count, ply, timings }, [ply.buffer]);
    await isShown; // decoding takes all of a processor core, which drawing may need
  }
  reply({ kind: "done" });
}

/** Load the first model of the page. */
async function loadAhead(): Promise<Loaded> {
  const [modelId] = await fetchModelIds();
  return load(modelId);
}

async function load(modelId: string): Promise<Loaded> {
  const [{ wasm, tables }, model] = await Promise.all([runtime, fetchModel(modelId)]);
  return { modelId, decoder: await Decoder.load(wasm, tables, model) };
}

/** Return the decoder of a model. Throws Refusal if the page does not have the model. */
async function decoderOf(modelId: string): Promise<Decoder> {
  const loaded = await ahead;
  return (loaded.modelId === modelId ? loaded : await load(modelId)).decoder;
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
