/** Messages between the page and its decoder worker. */

import type { StoredCameras } from "../container/cameras";
import type { Timing } from "../decoder";

/** What the page shows of a stream before it is decoded. */
export interface Summary {
  bytes: number;
  version: string;
  modelId: string;
  height: number;
  width: number;
  stages: number;
  /** Name and size in bytes of the header and of every section. */
  parts: [string, number][];
  cameras: StoredCameras;
  /** Message about damage after the decodable stages, null for an intact stream. */
  damage: string | null;
}

export type Request =
  | { kind: "decode"; data: Uint8Array }
  /** The last stage is on the screen: decode the next one. */
  | { kind: "continue" };

export type Reply =
  | { kind: "summary"; summary: Summary }
  /** The decoder is loaded. ms: waiting time. */
  | { kind: "ready"; ms: number }
  | { kind: "stage"; stage: number; count: number; ply: Uint8Array<ArrayBuffer>; timings: Timing[] }
  | { kind: "done" }
  | { kind: "refused"; message: string; rule: string }
  | { kind: "failed"; message: string };
