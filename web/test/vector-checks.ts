/** Checks of the vectors of bitstream_spec/vectors against expected.json, for Node and browsers alike. */

import { sha256 } from "@noble/hashes/sha2.js";
import { decodeDetail } from "../src/coding/detail-decoder";
import type { Field } from "../src/coding/field";
import type { Latents } from "../src/coding/latent-decoder";
import { type PriorModel, readPriorModel } from "../src/coding/prior-model";
import { decodeStage, unknownModel } from "../src/coding/stage-decoder";
import { hex, Refusal } from "../src/container/refusal";
import { readStream, type Stream } from "../src/container/stream";
import { readTables, type Table } from "../src/entropy/tables";

export interface GoodVector {
  model_id: string;
  size: number[];
  lambda_q: number[];
  cameras: string;
  coverage: string | null;
  fading: string | null;
  detail: { step: number; payload_bytes: number; symbols: string } | null;
  metadata: boolean;
  stages: { payload_bytes: number; digest: string; symbols: string[]; z_hat: string; y_hat: string }[];
}

export interface FaultyVector {
  rule: string;
  says: string;
}

export interface Expected {
  good: Record<string, GoodVector>;
  faulty: Record<string, FaultyVector>;
}

/** What decoding needs: the tables of the format, and models by id. */
export interface Decoding {
  tables: Table[];
  models: Map<string, PriorModel>;
}

export function decodingOf(tables: Uint8Array, weights: Uint8Array[]): Decoding {
  const models = weights.map((data) => [hex(sha256(data).subarray(0, 8)), readPriorModel(data)] as const);
  return { tables: readTables(tables), models: new Map(models) };
}

/** Return what was found in a valid stream, in the form of expected.json. */
export function found(data: Uint8Array, decoding: Decoding): GoodVector {
  const stream = readStream(data);
  const { header } = stream;
  const { stages, planes } = decodeAll(stream, decoding);
  return {
    model_id: header.modelId,
    size: [header.views, header.height, header.width],
    lambda_q: stages.map((_, at) => header.lambdaQ + (at === 0 ? 2 * header.excess : 0)),
    cameras: fingerprint(cameraBytes(stream)),
    coverage: stream.coverage && fingerprint(stream.coverage),
    fading: stream.fading && fingerprint(stream.fading),
    detail: stream.detail && {
      step: stream.detail.step,
      payload_bytes: stream.detail.payload.length,
      symbols: fingerprint(int64Bytes(planes.flatMap((symbols) => [...symbols]))),
    },
    metadata: stream.metadata !== null,
    stages: stages.map(({ batches, zHat, yHat }, at) => ({
      payload_bytes: stream.payloads[at].length,
      digest: header.digests[at],
      symbols: batches.map((batch) => fingerprint(int64Bytes(batch))),
      z_hat: fingerprint(int64Bytes(clipped(zHat))),
      y_hat: fingerprint(int64Bytes(clipped(yHat))),
    })),
  };
}

/** Return the refusal of a faulty stream, null if it was not refused. */
export function refusalOf(data: Uint8Array, decoding: Decoding): Refusal | null {
  try {
    decodeAll(readStream(data), decoding);
    return null;
  } catch (error) {
    if (error instanceof Refusal) return error;
    throw error;
  }
}

/** planes: symbols of each plane of detail, [view, row, column]; none for a stream without detail. */
function decodeAll(stream: Stream, { tables, models }: Decoding): { stages: Latents[]; planes: Int32Array[] } {
  const model = models.get(stream.header.modelId);
  if (!model) throw unknownModel(stream.header.modelId, [...models.keys()]);
  const stages: Latents[] = [];
  for (let stage = 1; stage <= stream.payloads.length; stage++) {
    stages.push(decodeStage(stream, stage, stages.at(-1)?.yHat ?? null, model, tables));
  }
  return { stages, planes: stream.detail ? decodeDetail(stream.detail, stream.header, model, tables) : [] };
}

function fingerprint(bytes: Uint8Array): string {
  return hex(sha256(bytes)).slice(0, 16);
}

function clipped({ values }: Field): Float64Array {
  return values.map((value) => Math.min(Math.max(value, -(2 ** 24)), 2 ** 24));
}

function int64Bytes(values: ArrayLike<number>): Uint8Array {
  return new Uint8Array(BigInt64Array.from({ length: values.length }, (_, at) => BigInt(values[at])).buffer);
}

function cameraBytes({ cameras }: Stream): Uint8Array {
  const views = cameras.views.flatMap(({ intrinsics, rotation, centre }) => [
    ...intrinsics,
    ...[0, 1, 2].flatMap((row) => [...rotation.slice(3 * row, 3 * row + 3), centre[row]]),
  ]);
  return new Uint8Array(Float32Array.of(cameras.near, cameras.far, ...views).buffer);
}
