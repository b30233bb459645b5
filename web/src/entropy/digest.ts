/** The symbol digest (ENTROPY.md, section 8). */

import { blake2b } from "@noble/hashes/blake2.js";
import { hex } from "../container/refusal";

/** Return the digest of the batches of a stage in hexadecimal. */
export function symbolDigest(batches: Int32Array[]): string {
  const hash = blake2b.create({ dkLen: 8 });
  for (const batch of batches) {
    const bytes = new DataView(new ArrayBuffer(4 * batch.length));
    batch.forEach((symbol, at) => bytes.setInt32(4 * at, symbol, true));
    hash.update(new Uint8Array(bytes.buffer));
  }
  return hex(hash.digest());
}
