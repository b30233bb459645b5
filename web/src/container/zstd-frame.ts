/** One zstd frame (RFC 8878) with a stated content size. Only this file imports fzstd. */

import { decompress } from "fzstd";
import { xxh64Low } from "./xxh64";

const MAGIC = 0xfd2fb528;
const DICTIONARY_ID_BYTES = [0, 1, 2, 4];

export interface Frame {
  /** Size of the content in bytes, null if the frame does not state it. */
  contentSize: number | null;
  windowSize: number;
  hasChecksum: boolean;
  /** Offset of the first block in bytes. */
  blocks: number;
}

/** Parse the header of a frame. Throws Error if it is not valid. */
export function readFrame(data: Uint8Array): Frame {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  requireBytes(data, 6);
  if (view.getUint32(0, true) !== MAGIC) throw new Error("unknown frame");
  const descriptor = data[4];
  if (descriptor & 0x08) throw new Error("a reserved bit is set");
  const isSingleSegment = (descriptor & 0x20) !== 0;
  const idBytes = DICTIONARY_ID_BYTES[descriptor & 3];
  const sizeFlag = descriptor >> 6;
  const sizeBytes = sizeFlag === 0 ? (isSingleSegment ? 1 : 0) : 1 << sizeFlag;
  const idAt = isSingleSegment ? 5 : 6;
  const blocks = idAt + idBytes + sizeBytes;
  requireBytes(data, blocks);
  if (data.subarray(idAt, idAt + idBytes).some((byte) => byte !== 0)) throw new Error("it needs a dictionary");
  const contentSize = sizeBytes === 0 ? null : sizeOf(view, idAt + idBytes, sizeBytes);
  const windowSize = isSingleSegment ? (contentSize as number) : windowOf(data[5]);
  return { contentSize, windowSize, hasChecksum: (descriptor & 0x04) !== 0, blocks };
}

/** Return the content of a frame that takes all of the data. Throws Error if the frame is not valid. */
export function frameContent(data: Uint8Array, frame: Frame): Uint8Array {
  const end = endOfBlocks(data, frame.blocks) + (frame.hasChecksum ? 4 : 0);
  if (end !== data.length) throw new Error(`the frame ends at byte ${end} of ${data.length}`);
  const content = decompress(data);
  if (content.length !== frame.contentSize) throw new Error("its content has another size than stated");
  if (frame.hasChecksum) {
    const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
    if (xxh64Low(content) !== view.getUint32(end - 4, true)) throw new Error("its checksum is wrong");
  }
  return content;
}

function endOfBlocks(data: Uint8Array, start: number): number {
  let at = start;
  for (;;) {
    requireBytes(data, at + 3);
    const head = data[at] | (data[at + 1] << 8) | (data[at + 2] << 16);
    const [isLast, type, size] = [head & 1, (head >> 1) & 3, head >> 3];
    if (type === 3) throw new Error("a block has a reserved type");
    at += 3 + (type === 1 ? 1 : size);
    requireBytes(data, at);
    if (isLast) return at;
  }
}

function sizeOf(view: DataView, at: number, bytes: number): number {
  if (bytes === 1) return view.getUint8(at);
  if (bytes === 2) return view.getUint16(at, true) + 256;
  if (bytes === 4) return view.getUint32(at, true);
  return Number(view.getBigUint64(at, true));
}

function windowOf(descriptor: number): number {
  const base = 2 ** (10 + (descriptor >> 3));
  return base + (base / 8) * (descriptor & 7);
}

function requireBytes(data: Uint8Array, count: number): void {
  if (data.length < count) throw new Error("it is truncated");
}
