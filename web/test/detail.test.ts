/** The detail section: how it is read, and how its symbols are decoded. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { addMagnitudes, decodeDetail, detailValues, stepSize, tableIndices } from "../src/coding/detail-decoder";
import type { PriorModel } from "../src/coding/prior-model";
import { Kind } from "../src/container/sections";
import { readIntact, readPrefix, readStream } from "../src/container/stream";
import { readTables } from "../src/entropy/tables";
import { refusalOf, withSection } from "./changed-streams";

const ROOT = join(process.cwd(), "..");
const read = (...path: string[]) => new Uint8Array(readFileSync(join(ROOT, ...path)));
const FILE = read("bitstream_spec", "vectors", "valid", "landscape.fcs"); // 2 views of 64x128 pixels
const STREAM = readStream(FILE);
const TABLES = readTables(read("fecocodec", "entropy", "symbol_tables.bin"));
const NOTHING = new Uint8Array(0);
const [ROWS, COLUMNS] = [8, 16]; // of a plane of a view

/** Return a model with as many planes of detail; `indices` are table indices by bucket, 0 for the others. */
function modelOf(...planes: Record<number, number>[]): PriorModel {
  const detail = planes.map((indices) => Uint8Array.from({ length: 16 }, (_, bucket) => indices[bucket] ?? 0));
  return { layers: new Map(), latent: 0, hyper: 0, width: 0, detail };
}

test("the section is read, but not with a prefix", () => {
  const file = withSection(FILE, Kind.detail, Uint8Array.of(63, 1, 2, 3), "B2");
  assert.deepEqual(readStream(file).detail, { step: 63, payload: Uint8Array.of(1, 2, 3) });
  assert.equal(readPrefix(file, 2).detail, null);
  assert.equal(STREAM.detail, null);
});

test("a stream of one stage can have detail", () => {
  const file = read("bitstream_spec", "vectors", "valid", "one-stage.fcs");
  const { detail } = readStream(withSection(file, Kind.detail, Uint8Array.of(7), "B1"));
  assert.deepEqual(detail, { step: 7, payload: NOTHING });
});

test("a stream with damaged detail is decoded without it", () => {
  const file = withSection(FILE, Kind.detail, Uint8Array.of(7, 1), "B2");
  const { offset, end } = readStream(file).sections.find(({ name }) => name === "detail")!;
  file[end - 1] ^= 1;
  const { stream, damage } = readIntact(file);
  assert.deepEqual([stream.payloads.length, stream.detail], [2, null]);
  assert.ok(damage?.startsWith(`section detail at byte ${offset}: CRC-32 is`), damage ?? "no damage");
});

for (const [rule, kind, payload, after, says] of [
  ["detail is not empty", Kind.detail, [], "B2", "it is empty, it must hold a step; the program that wrote it"],
  ["step within its limit", Kind.detail, [64, 1], "B2", "its step is 64, allowed are 0 to 63; the program that wrote it"],
  ["critical bit of a known kind", 0x38, [7], "B2", "the critical bit of this kind is wrong"],
  ["ascending order", Kind.detail, [7], "B1", "it must stand before section detail"],
] as const) {
  test(`a section that breaks the rule "${rule}" is refused`, () => {
    const refusal = refusalOf(() => readStream(withSection(FILE, kind, Uint8Array.from(payload), after)));
    assert.equal(refusal.rule, rule);
    assert.ok(refusal.message.includes(`: ${says}`), refusal.message);
  });
}

test("buckets follow the magnitudes of earlier planes, also in the neighbourhood", () => {
  const symbols = [
    [0, 0, 0, 0],
    [0, 3, 0, 0],
    [0, -1, 0, 0],
    [0, 0, 0, 20],
  ].flat(); // the example of ENTROPY.md, section 7.2
  const buckets = [
    [0, 3, 0, 0],
    [3, 5, 3, 0],
    [1, 4, 1, 8],
    [0, 1, 8, 10],
  ].flat();
  const earlier = new Int32Array(32);
  addMagnitudes(earlier, Int32Array.from([...symbols, ...symbols.toReversed()])); // two views
  const everyBucket = Uint8Array.from({ length: 16 }, (_, bucket) => bucket);
  assert.deepEqual([...tableIndices(everyBucket, earlier, [2, 4, 4])], [...buckets, ...buckets.toReversed()]);
  const firstRow = () => [...tableIndices(everyBucket, earlier, [2, 4, 4])].slice(0, 4);
  addMagnitudes(earlier, new Int32Array(32).fill(-20));
  assert.deepEqual(firstRow(), [12, 13, 13, 12]); // all sums are larger by 15, the contexts are 60, 78, 75 and 60
  addMagnitudes(earlier, new Int32Array(32).fill(20));
  assert.deepEqual(firstRow(), [14, 15, 15, 14]); // 120, 153, 150 and 120
});

test("contexts select the tables of later planes, and values are ordered by view, then plane", () => {
  // An empty payload has the first entry of every table: minus its reach. Tables below 6 are not coded.
  const model = modelOf({ 0: 6 }, { 8: 30 }, { 11: 9, 13: 13, 14: 16 });
  const values = detailValues({ step: 4, payload: NOTHING }, STREAM.header, model, TABLES);
  const isEnd = (at: number, size: number) => at === 0 || at === size - 1;
  // By the number of sides of the plane that a position touches: inside, at an edge, at a corner.
  const symbolsOf = [[-3, -3, -3], [-19, -19, 0], [-6, -5, -4]];
  const view = symbolsOf.flatMap((symbols) =>
    Array.from({ length: ROWS * COLUMNS }, (_, at) => {
      const sides = Number(isEnd(Math.floor(at / COLUMNS), ROWS)) + Number(isEnd(at % COLUMNS, COLUMNS));
      return Math.fround(symbols[sides] * Math.fround(Math.SQRT1_2)) + 0; // + 0: no -0
    }),
  );
  assert.deepEqual([...values], [...view, ...view]);
});

test("a symbol of 1 has the value of the step, rounded to float32", () => {
  assert.deepEqual([0, 8, 56].map(stepSize), [1, 0.5, 1 / 128]);
  assert.deepEqual([1, 63].map(stepSize), [0.91700405, 0.004259796].map(Math.fround)); // from NumPy
});

test("a stream without detail has values of 0", () => {
  const values = detailValues(null, STREAM.header, modelOf({ 0: 6 }, {}), TABLES);
  assert.deepEqual([values.length, values.some((value) => value !== 0)], [2 * 2 * ROWS * COLUMNS, false]);
});

test("payloads that do not end with the symbols are refused", () => {
  const payload = Uint8Array.of(0, 0, 0, 1);
  const refusal = refusalOf(() => decodeDetail({ step: 0, payload }, STREAM.header, modelOf({}), TABLES));
  assert.equal(refusal.rule, "state 0 and no words at the end");
});

test("detail is refused if the model has none", () => {
  const refusal = refusalOf(() => detailValues({ step: 0, payload: NOTHING }, STREAM.header, modelOf(), TABLES));
  assert.ok(refusal.message.includes(`the model ${STREAM.header.modelId} has no detail`), refusal.message);
});
