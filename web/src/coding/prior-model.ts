/** The entropy model in a safetensors file (ENTROPY.md, section 6). */

import { IntegerLayer } from "./integer-layer";

export interface PriorModel {
  layers: Map<string, IntegerLayer>;
  /** Channels of y, of z, and the width of the hidden layers. */
  latent: number;
  hyper: number;
  width: number;
  /** Table indices by bucket of each plane of detail, 16 each; empty if the model has no detail. */
  detail: Uint8Array[];
}

const DETAIL_TABLES = "detail.tables";
const BUCKETS = 16;
const BYTES_OF = { U8: 1, I16: 2, I32: 4 };

interface Tensor {
  dtype: string;
  shape: number[];
  data_offsets: [number, number];
}

/**
 * Parse the tensors `prior.*` and, if the model has detail, `detail.tables` of a safetensors file. Throws Error if one
 * is missing or has a wrong type.
 */
export function readPriorModel(data: Uint8Array): PriorModel {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  const headerBytes = Number(view.getBigUint64(0, true));
  const header = JSON.parse(new TextDecoder().decode(data.subarray(8, 8 + headerBytes))) as Record<string, Tensor>;
  const body = data.subarray(8 + headerBytes);
  const layers = new Map<string, IntegerLayer>();
  for (const key of Object.keys(header)) {
    const name = /^prior\.(.*)\.weight$/.exec(key)?.[1];
    if (name === undefined) continue;
    const weight = integers(body, header[key], "I16", key);
    const bias = integers(body, header[`prior.${name}.bias`], "I32", `prior.${name}.bias`);
    const [groups, inputs, outputs] = header[key].shape;
    layers.set(name, new IntegerLayer(weight, bias, groups, inputs, outputs));
  }
  const outputsOf = (name: string) => layerOf(layers, name).outputs;
  return {
    layers,
    latent: 2 * outputsOf("steps.1.leave"),
    hyper: outputsOf("hyper_prior") / 2,
    width: outputsOf("merge_8"),
    detail: detailTables(body, header[DETAIL_TABLES]),
  };
}

/** Return a layer by name. Throws Error if the model lacks it. */
export function layerOf(layers: Map<string, IntegerLayer>, name: string): IntegerLayer {
  const layer = layers.get(name);
  if (!layer) throw new Error(`Entropy model: layer ${name} is missing.`);
  return layer;
}

function detailTables(body: Uint8Array, tensor: Tensor | undefined): Uint8Array[] {
  if (!tensor) return [];
  const values = Uint8Array.from(integers(body, tensor, "U8", DETAIL_TABLES));
  return Array.from({ length: tensor.shape[0] }, (_, plane) => values.subarray(BUCKETS * plane, BUCKETS * (plane + 1)));
}

function integers(
  body: Uint8Array,
  tensor: Tensor | undefined,
  dtype: keyof typeof BYTES_OF,
  name: string,
): Int32Array {
  const size = BYTES_OF[dtype];
  const count = tensor?.shape.reduce((product, side) => product * side, 1) ?? 0;
  if (tensor?.dtype !== dtype || tensor.data_offsets[1] - tensor.data_offsets[0] !== size * count) {
    throw new Error(`Entropy model: tensor ${name} is missing or has a wrong type or size.`);
  }
  const view = new DataView(body.buffer, body.byteOffset + tensor.data_offsets[0], size * count);
  const value = {
    U8: (at: number) => view.getUint8(at),
    I16: (at: number) => view.getInt16(2 * at, true),
    I32: (at: number) => view.getInt32(4 * at, true),
  }[dtype];
  return Int32Array.from({ length: count }, (_, at) => value(at));
}
