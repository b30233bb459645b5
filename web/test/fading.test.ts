/** The fading section: how it is read, and what it does to Gaussians. */

import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { deflateRawSync } from "node:zlib";
import { Kind } from "../src/container/sections";
import { readPrefix, readStream, type Stream } from "../src/container/stream";
import { emit } from "../src/receiver/emission";
import type { Gaussians } from "../src/receiver/gaussians";
import { normalise } from "../src/receiver/normalised-cameras";
import { refusalOf, withSection } from "./changed-streams";
import { surfaceGaussians } from "./surface-gaussians";

const VALID = join(process.cwd(), "..", "bitstream_spec", "vectors", "valid");
const FILE = new Uint8Array(readFileSync(join(VALID, "landscape.fcs")));
const STREAM = readStream(FILE);
const VIEWS = 2;
const [ROWS, COLUMNS] = [4, 8]; // blocks of a view of 64x128 pixels
const LEVELS = Array.from({ length: VIEWS * ROWS * COLUMNS }, (_, block) => (block ** 2 + (block >> 2)) % 4);
const FACTORS = [1, 0.6666667, 0.33333334, 0].map(Math.fround);

/** Return the content of the section, by the rules of FORMAT.md: the first block has the highest bits. */
function packed(levels: number[]): Uint8Array {
  const bits = levels.map((level) => level.toString(2).padStart(2, "0")).join("");
  return Uint8Array.from(bits.match(/.{8}/g) as string[], (byte) => parseInt(byte, 2));
}

/** Return Gaussians at depth 10 before the cameras of the stream, one for each 2x2 pixels. */
function predicted(opacityOf: (index: number) => number): Gaussians {
  const { views } = normalise(STREAM.cameras);
  return surfaceGaussians(views, [8 * ROWS, 8 * COLUMNS], ({ index }) => ({ depth: 10, opacity: opacityOf(index) }));
}

function emitted(gaussians: Gaussians, sections: Partial<Stream>): Gaussians {
  return emit(gaussians, gaussians.harmonics, normalise(STREAM.cameras), { ...STREAM, ...sections });
}

/** Return the level of the block of each Gaussian. */
function levelsOf(gaussians: Gaussians): number[] {
  return Array.from({ length: gaussians.count }, (_, index) => {
    const [view, row, column] = [index >> 11, (index >> 6) & 31, index & 63]; // 32x64 Gaussians a view
    return LEVELS[(view * ROWS + Math.floor(row / 8)) * COLUMNS + Math.floor(column / 8)];
  });
}

test("the section is read", () => {
  const file = withSection(FILE, Kind.fading, deflateRawSync(packed(LEVELS)), "cameras");
  assert.deepEqual([...readStream(file).fading!], [...packed(LEVELS)]);
  assert.deepEqual([...readPrefix(file, 1).fading!], [...packed(LEVELS)]);
  assert.equal(STREAM.fading, null);
});

test("blocks that do not have their size are refused", () => {
  const refusal = refusalOf(() => readStream(withSection(FILE, Kind.fading, deflateRawSync(new Uint8Array(15)), "cameras")));
  assert.equal(refusal.rule, "blocks of fading have their size");
  const { offset } = STREAM.sections[1];
  const start = `section fading at byte ${offset}: its blocks take 15 bytes, the views need 16; the program that wrote it`;
  assert.ok(refusal.message.startsWith(start), refusal.message);
});

for (const [rule, kind, payload, after] of [
  ["Deflate data not too long", Kind.fading, deflateRawSync(new Uint8Array(17)), "cameras"],
  ["length within the limit", Kind.fading, new Uint8Array(2 ** 15 + 1), "cameras"],
  ["critical bit of a known kind", 0x1c, deflateRawSync(new Uint8Array(16)), "cameras"],
  ["ascending order", Kind.fading, deflateRawSync(new Uint8Array(16)), "B1"],
] as const) {
  test(`a section that breaks the rule "${rule}" is refused`, () => {
    assert.equal(refusalOf(() => readStream(withSection(FILE, kind, payload, after))).rule, rule);
  });
}

test("opacities are multiplied by the factor of their block, then the faint Gaussians are dropped", () => {
  const gaussians = predicted((index) => (index * 0.377) % 1);
  const faded = levelsOf(gaussians).map((level, index) => Math.fround(gaussians.opacities[index] * FACTORS[level]));
  const wanted = faded.filter((opacity) => opacity >= Math.fround(1 / 255));
  const isFadedAway = faded.map((opacity, index) => 0 < opacity && opacity < 1 / 255 && 1 / 255 < gaussians.opacities[index]);
  assert.ok(isFadedAway.includes(true), "or this test sees nothing");
  const found = emitted(gaussians, { fading: packed(LEVELS) }).opacities;
  assert.deepEqual([...found.subarray(0, wanted.length)], wanted);
  assert.ok(found.subarray(wanted.length).every((opacity) => opacity === Math.fround(0.95)), "the rest is background");
});

test("cells that are not covered are dropped, whatever their block says", () => {
  const gaussians = predicted(() => 0.75);
  const coverage = new Uint8Array((VIEWS * 16 * 32) / 8).fill(0x80); // of 8 cells in a row, the first
  const wanted = levelsOf(gaussians).filter((level, index) => index % 16 < 2 && level < 3); // a cell is 2 Gaussians wide
  const found = emitted(gaussians, { coverage, fading: packed(LEVELS) }).opacities;
  assert.deepEqual([...found.subarray(0, wanted.length)], wanted.map((level) => Math.fround(0.75 * FACTORS[level])));
});

test("the background layer sees faded opacities", () => {
  const gaussians = predicted(() => 0.02);
  const all = (level: number) => emitted(gaussians, { fading: packed(LEVELS.map(() => level)) });
  assert.ok(all(0).count > gaussians.count, "there is a background");
  assert.deepEqual(all(0), emitted(gaussians, { fading: null }));
  assert.equal(all(2).count, gaussians.count, "0.0067 is drawn, but not extrapolated");
  assert.equal(all(3).count, 0);
});
