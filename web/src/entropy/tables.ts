/** The frequency tables of the format (ENTROPY.md, section 4). */

import { sha256 } from "@noble/hashes/sha2.js";
import { hex } from "../container/refusal";

const SHA256 = "b48cf11ed8025fa24296cda054e9917eb96d004be7d83b91395714867feb34c2";
const COUNT = 64;

export interface Table {
  /** The table has the symbols -reach..reach and the escape. */
  reach: number;
  /** Sum of the frequencies before each entry, and 2^24 at the end. */
  starts: Uint32Array;
}

/** Parse the file of tables. Throws Error if it is not the one that the format defines. */
export function readTables(data: Uint8Array): Table[] {
  if (hex(sha256(data)) !== SHA256) throw new Error("symbol_tables.bin: these are not the tables of the format.");
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  let at = 0;
  return Array.from({ length: COUNT }, () => {
    const reach = view.getUint16(at, true);
    at += 2;
    const starts = new Uint32Array(2 * reach + 3);
    for (let entry = 0; entry < 2 * reach + 2; entry++, at += 4) {
      starts[entry + 1] = starts[entry] + view.getUint32(at, true);
    }
    return { reach, starts };
  });
}
