/** The sections coverage and fading: a few bits for each square of the views (FORMAT.md, sections 8.1 and 8.2). */

import type { Header } from "./header";
import { inflate } from "./inflate";
import { BAD_WRITER, Refusal } from "./refusal";

interface ViewGrids {
  section: string;
  /** What the squares are called in messages. */
  squares: string;
  /** Side of a square of the coding grid in pixels. */
  side: number;
  bits: number;
}

export const COVERAGE: ViewGrids = { section: "coverage", squares: "cells", side: 4, bits: 1 };
export const FADING: ViewGrids = { section: "fading", squares: "blocks", side: 16, bits: 2 };

/** Return the bits of the squares, by view, row, column, the highest bits of a byte first. place: start of messages. */
export function readViewGrids(grids: ViewGrids, payload: Uint8Array, header: Header, place: string): Uint8Array {
  const { section, squares, side, bits } = grids;
  const size = (header.views * (header.gridHeight / side) * (header.gridWidth / side) * bits) / 8;
  const values = inflate(payload, size, place);
  if (values.length !== size) {
    throw new Refusal(
      `${squares} of ${section} have their size`,
      `${place}: its ${squares} take ${values.length} bytes, the views need ${size}; ${BAD_WRITER}`,
    );
  }
  return values;
}
