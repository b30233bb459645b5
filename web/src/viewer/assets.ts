/** The files that decoding needs, fetched from the folder of the page. */

import { unknownModel } from "../coding/stage-decoder";
import { GRAPHS } from "../receiver/graph-names";
import type { ModelFiles } from "../receiver/graphs";

export interface Runtime {
  wasm: Uint8Array;
  tables: Uint8Array;
}

/** Fetch what all models need. */
export async function fetchRuntime(): Promise<Runtime> {
  const [wasm, tables] = await Promise.all([fetchBytes("ort.wasm"), fetchBytes("symbol_tables.bin")]);
  return { wasm, tables };
}

/** Fetch the model ids of the page, at least one. */
export async function fetchModelIds(): Promise<string[]> {
  return JSON.parse(new TextDecoder().decode(await fetchBytes("models.json"))) as string[];
}

/** Fetch the files of a model. Throws Refusal if the page does not have it. */
export async function fetchModel(modelId: string): Promise<ModelFiles> {
  const known = await fetchModelIds();
  if (!known.includes(modelId)) throw unknownModel(modelId, known);
  const file = (name: string) => fetchBytes(`models/${modelId}/${name}`);
  const [weights, ...graphs] = await Promise.all(["receiver.safetensors", ...GRAPHS.map((name) => `${name}.onnx`)].map(file));
  return { weights, graphs: Object.fromEntries(GRAPHS.map((name, at) => [name, graphs[at]])) as ModelFiles["graphs"] };
}

/** Fetch a file. Throws Error with a sentence for the page. */
export async function fetchBytes(url: string): Promise<Uint8Array> {
  const response = await fetch(url).catch((error: unknown) => {
    throw new Error(`${url}: it cannot be fetched (${String(error)}); files on other hosts are not loaded. Drop the file here.`);
  });
  if (!response.ok) {
    throw new Error(`${url}: the server answered ${response.status}; check the address or drop the file here.`);
  }
  return new Uint8Array(await response.arrayBuffer());
}
