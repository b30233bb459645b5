/** Batches of symbols (ENTROPY.md, section 3). */

import { Refusal } from "../container/refusal";
import type { AnsDecoder } from "./ans-decoder";
import type { Table } from "./tables";

const FIRST_CODED = 6;
const HIGHEST_EXPONENT = 19;
const SYMBOL_LIMIT = 2 ** 20;

/** Decode the symbols of a batch. tableIndices: 0..63, of each element. Throws Refusal for a damaged payload. */
export function decodeBatch(decoder: AnsDecoder, tables: Table[], tableIndices: Uint8Array): Int32Array {
  const symbols = new Int32Array(tableIndices.length);
  const escaped: number[] = [];
  for (const element of codingOrder(tableIndices, tables.length)) {
    const table = tables[tableIndices[element]];
    const entry = decoder.entry(table);
    symbols[element] = entry - table.reach;
    if (entry > 2 * table.reach) escaped.push(element);
  }
  const exponents = escaped.map(() => decoder.bits(5));
  const highest = exponents.reduce((most, exponent) => Math.max(most, exponent), 0);
  if (highest > HIGHEST_EXPONENT) {
    throw new Refusal(
      "exponent at most 19",
      `payload: an escape has the exponent ${highest}, at most ${HIGHEST_EXPONENT} is allowed; the payload is damaged.`,
    );
  }
  escaped.forEach((element, at) => {
    const mantissa = decoder.bits(exponents[at] + 1);
    const magnitude = tables[tableIndices[element]].reach + 2 ** exponents[at] + (mantissa >>> 1);
    if (magnitude > SYMBOL_LIMIT) {
      throw new Refusal(
        "magnitude at most 2^20",
        `payload: a symbol is ${magnitude} in magnitude, at most ${SYMBOL_LIMIT} is allowed; the payload is damaged.`,
      );
    }
    symbols[element] = mantissa % 2 ? -magnitude : magnitude;
  });
  return symbols;
}

/** Return the coded elements, sorted by table index; equal indices keep their order. */
function codingOrder(tableIndices: Uint8Array, numTables: number): Uint32Array {
  const counts = new Uint32Array(numTables);
  for (const index of tableIndices) counts[index] += 1;
  const next = new Uint32Array(numTables);
  for (let index = FIRST_CODED + 1; index < numTables; index++) next[index] = next[index - 1] + counts[index - 1];
  const order = new Uint32Array(next[numTables - 1] + counts[numTables - 1]);
  tableIndices.forEach((index, element) => {
    if (index >= FIRST_CODED) order[next[index]++] = element;
  });
  return order;
}
