/** Runs in the browser: checks all vectors and leaves what failed in `window.failures`. */

import { decodingOf, type Expected, found, refusalOf } from "../vector-checks";

declare global {
  interface Window {
    failures?: string[];
    checked?: number;
  }
}

async function read(path: string): Promise<Uint8Array> {
  const response = await fetch(path);
  if (!response.ok) throw new Error(`${path}: ${response.status}`);
  return new Uint8Array(await response.arrayBuffer());
}

async function check(): Promise<string[]> {
  const expected = JSON.parse(new TextDecoder().decode(await read("/vectors/expected.json"))) as Expected;
  const decoding = decodingOf(await read("/entropy/symbol_tables.bin"), [
    await read("/vectors/tiny.safetensors"),
    await read("/vectors/paper/receiver.safetensors"),
    await read("/weights/compact-6/receiver.safetensors"),
  ]);
  const failures: string[] = [];
  window.checked = 0;
  for (const [name, vector] of Object.entries(expected.good)) {
    const of = found(await read(`/vectors/${name}`), decoding) as unknown as Record<string, unknown>;
    for (const [field, value] of Object.entries(of)) {
      const wanted = (vector as unknown as Record<string, unknown>)[field];
      if (JSON.stringify(value) !== JSON.stringify(wanted)) failures.push(`${name}: ${field} differs`);
    }
    window.checked++;
  }
  for (const [name, { rule }] of Object.entries(expected.faulty)) {
    const refusal = refusalOf(await read(`/vectors/${name}`), decoding);
    if (refusal?.rule !== rule) failures.push(`${name}: refused by ${refusal?.rule}, not by ${rule}`);
    window.checked++;
  }
  return failures;
}

void check().then(
  (failures) => (window.failures = failures),
  (error: unknown) => (window.failures = [String(error)]),
);
