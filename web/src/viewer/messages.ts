/** Messages between the page and its decoder worker. */

import type { StoredCameras } from "../container/cameras";

/** Files that decoding needs, by name; `model` holds those of the stream's model. */
export interface Assets {
  wasm: Uint8Array;
  tables: Uint8Array;
  model: ModelFiles;
}

export interface ModelFiles {
  prior: Uint8Array;
  update: Uint8Array;
  points: Uint8Array;
  predict: Uint8Array;
}

export interface Summary {
  bytes: number;
  modelId: string;
  version: string;
  height: number;
  width: number;
  /** Name and size in bytes of the header and every section. */
  parts: [string, number][];
  cameras: StoredCameras;
  stages: number;
  /** Message about damage after the decodable stages, null for an intact stream. */
  damage: string | null;
}

/** Duration of a step of decoding in milliseconds. */
export interface Timing {
  step: string;
  ms: number;
}

export interface DecodedStage {
  stage: number;
  count: number;
  ply: Uint8Array<ArrayBuffer>;
  timings: Timing[];
}
