/** The fading section: two bits per block of 16x16 pixels of the coding grid (FORMAT.md, section 8.2). */

import type { Header } from "./header";
import { inflate } from "./inflate";
import { BAD_WRITER, Refusal } from "./refusal";

/** Return two bits per block, by view, row, column, the highest bits of a byte first. place: start of messages. */
export function readFading(payload: Uint8Array, header: Header, place: string): Uint8Array {
  const size = (header.views * (header.gridHeight / 16) * (header.gridWidth / 16)) / 4;
  const blocks = inflate(payload, size, place);
  if (blocks.length !== size) {
    throw new Refusal(
      "blocks of fading have their size",
      `${place}: its blocks take ${blocks.length} bytes, the views need ${size}; ${BAD_WRITER}`,
    );
  }
  return blocks;
}
