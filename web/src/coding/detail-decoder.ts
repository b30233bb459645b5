/** Decoding of detail, the numbers that correct the Gaussians of the last stage (ENTROPY.md, section 7.2). */

import type { Detail } from "../container/detail";
import type { Header } from "../container/header";
import { Refusal } from "../container/refusal";
import { AnsDecoder } from "../entropy/ans-decoder";
import { decodeBatch } from "../entropy/batch";
import type { Table } from "../entropy/tables";
import type { PriorModel } from "./prior-model";

const LARGEST_COUNTED = 15; // magnitude from which on larger symbols change no context
const THRESHOLDS = [1, 2, 3, 4, 6, 8, 11, 15, 20, 27, 36, 48, 64, 96, 140]; // lowest contexts of the buckets 1 to 15
const LAST_CONTEXT = THRESHOLDS[THRESHOLDS.length - 1]; // larger ones have the same bucket
const BUCKET_OF = Uint8Array.from(
  { length: LAST_CONTEXT + 1 },
  (_, context) => THRESHOLDS.filter((threshold) => threshold <= context).length,
);

/** Views, rows and columns of a plane. */
type Size = readonly [number, number, number];

/** Decode the symbols of each plane, [view, row, column]. Throws Refusal for a damaged payload or a model without detail. */
export function decodeDetail({ payload }: Detail, header: Header, model: PriorModel, tables: Table[]): Int32Array[] {
  if (model.detail.length === 0) {
    throw new Refusal(
      "the model has detail",
      `section detail: the model ${header.modelId} has no detail; the program that wrote the file is at fault, encode ` +
        "the scene again.",
    );
  }
  const size = sizeOf(header);
  const decoder = new AnsDecoder(payload);
  const earlier = new Int32Array(size[0] * size[1] * size[2]);
  const planes = model.detail.map((tableOfBucket) => {
    const symbols = decodeBatch(decoder, tables, tableIndices(tableOfBucket, earlier, size));
    addMagnitudes(earlier, symbols);
    return symbols;
  });
  decoder.end();
  return planes;
}

/**
 * Return symbols times their step, [view, plane of the model, row, column]; zeros for a stream without detail. Throws
 * what `decodeDetail` throws.
 */
export function detailValues(detail: Detail | null, header: Header, model: PriorModel, tables: Table[]): Float32Array {
  const [views, rows, columns] = sizeOf(header);
  const cells = rows * columns;
  const values = new Float32Array(views * model.detail.length * cells);
  if (!detail) return values;
  const step = stepSize(detail.step);
  decodeDetail(detail, header, model, tables).forEach((symbols, plane) => {
    for (let view = 0; view < views; view++) {
      const to = (view * model.detail.length + plane) * cells;
      for (let cell = 0; cell < cells; cell++) values[to + cell] = symbols[view * cells + cell] * step;
    }
  });
  return values;
}

/** Return the value of a symbol of 1, a float32 value. */
export function stepSize(step: number): number {
  return Math.fround(2 ** (-step / 8));
}

/** Add what the symbols of a plane contribute to the contexts of later planes. */
export function addMagnitudes(earlier: Int32Array, symbols: Int32Array): void {
  symbols.forEach((symbol, at) => (earlier[at] += Math.min(Math.abs(symbol), LARGEST_COUNTED)));
}

/**
 * Return the table index of each symbol of a plane, [view, row, column].
 *
 * tableOfBucket: of this plane, 16 table indices. earlier: sums of the magnitudes of the planes before.
 */
export function tableIndices(tableOfBucket: Uint8Array, earlier: Int32Array, [views, rows, columns]: Size): Uint8Array {
  const indices = new Uint8Array(earlier.length);
  for (let line = 0, at = 0; line < views * rows; line++) {
    const row = line % rows;
    for (let column = 0; column < columns; column++, at++) {
      let context = 2 * earlier[at];
      if (row > 0) context += earlier[at - columns];
      if (row < rows - 1) context += earlier[at + columns];
      if (column > 0) context += earlier[at - 1];
      if (column < columns - 1) context += earlier[at + 1];
      indices[at] = tableOfBucket[BUCKET_OF[Math.min(context, LAST_CONTEXT)]];
    }
  }
  return indices;
}

function sizeOf(header: Header): Size {
  return [header.views, header.gridHeight / 8, header.gridWidth / 8];
}
