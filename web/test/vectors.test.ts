import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { join } from "node:path";
import { test } from "node:test";
import { decodingOf, type Expected, found, refusalOf } from "./vector-checks";

const ROOT = join(process.cwd(), "..");
const VECTORS = join(ROOT, "bitstream_spec", "vectors");
const read = (...path: string[]) => new Uint8Array(readFileSync(join(...path)));
const expected = JSON.parse(readFileSync(join(VECTORS, "expected.json"), "utf8")) as Expected;
const decoding = decodingOf(read(ROOT, "fecocodec", "entropy", "symbol_tables.bin"), [
  read(VECTORS, "tiny.safetensors"),
  read(VECTORS, "paper", "receiver.safetensors"),
  read(ROOT, "fecocodec", "weights", "compact-6", "receiver.safetensors"),
]);

test("there are vectors", () => {
  assert.ok(Object.keys(expected.good).length >= 24);
  assert.ok(Object.keys(expected.faulty).length >= 40);
});

for (const [name, { ...vector }] of Object.entries(expected.good)) {
  test(`${name} has the expected content`, () => {
    const { breaks: _breaks, sha256: _sha256, ...wanted } = vector as unknown as Record<string, unknown>;
    assert.deepEqual(found(read(VECTORS, name), decoding), wanted);
  });
}

for (const [name, { rule }] of Object.entries(expected.faulty)) {
  test(`${name} is refused with its rule`, () => {
    const refusal = refusalOf(read(VECTORS, name), decoding);
    assert.equal(refusal?.rule, rule, refusal?.message);
  });
}
