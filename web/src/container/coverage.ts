/** The coverage section: one bit per cell of 4x4 pixels of the coding grid (FORMAT.md, section 8.1). */

import type { Header } from "./header";
import { inflate } from "./inflate";
import { BAD_WRITER, Refusal } from "./refusal";

/** Return one bit per cell, by view, row, column, the highest bit of a byte first. place: start of messages. */
export function readCoverage(payload: Uint8Array, header: Header, place: string): Uint8Array {
  const size = (header.views * (header.gridHeight / 4) * (header.gridWidth / 4)) / 8;
  const cells = inflate(payload, size, place);
  if (cells.length !== size) {
    throw new Refusal(
      "cells of coverage have their size",
      `${place}: its cells take ${cells.length} bytes, the views need ${size}; ${BAD_WRITER}`,
    );
  }
  return cells;
}
