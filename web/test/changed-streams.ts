/** Streams with one more section, and refusals, for tests. */

import { crc32 } from "../src/container/crc32";
import { Refusal } from "../src/container/refusal";
import { readStream } from "../src/container/stream";

/** Return a file with one section more after the section `after`. */
export function withSection(file: Uint8Array, kind: number, payload: Uint8Array, after: string): Uint8Array {
  const head = new Uint8Array(9);
  const view = new DataView(head.buffer);
  view.setUint8(0, kind);
  view.setUint32(1, payload.length, true);
  view.setUint32(5, crc32(head.subarray(0, 5), payload), true);
  const { header, sections } = readStream(file);
  const at = sections.find(({ name }) => name === after)!.end;
  const changed = Uint8Array.from([...file.subarray(0, at), ...head, ...payload, ...file.subarray(at)]);
  changed[26]++; // number of sections
  new DataView(changed.buffer).setUint32(header.end - 4, crc32(changed.subarray(0, header.end - 4)), true);
  return changed;
}

/** Return the refusal that an action ends in. */
export function refusalOf(action: () => unknown): Refusal {
  try {
    action();
  } catch (error) {
    if (error instanceof Refusal) return error;
    throw error;
  }
  throw new Error("it was not refused");
}
