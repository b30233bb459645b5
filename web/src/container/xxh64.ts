/** XXH64 with seed 0, the checksum of zstd frames (Collet, "xxHash fast digest algorithm", version 0.1.1). */

const [P1, P2, P3, P4, P5] = [
  0x9e3779b185ebca87n,
  0xc2b2ae3d27d4eb4fn,
  0x165667b19e3779f9n,
  0x85ebca77c2b2ae63n,
  0x27d4eb2f165667c5n,
];

/** Return the low 32 bits of the hash. Meant for up to a few kilobytes, because it is slow. */
export function xxh64Low(data: Uint8Array): number {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  let [at, hash] = stripes(view);
  hash = wrap(hash + BigInt(data.length));
  for (; at + 8 <= data.length; at += 8) {
    hash = wrap(rotate(hash ^ round(0n, view.getBigUint64(at, true)), 27n) * P1 + P4);
  }
  if (at + 4 <= data.length) {
    hash = wrap(rotate(hash ^ wrap(BigInt(view.getUint32(at, true)) * P1), 23n) * P2 + P3);
    at += 4;
  }
  for (; at < data.length; at++) hash = wrap(rotate(hash ^ wrap(BigInt(data[at]) * P5), 11n) * P1);
  hash = wrap((hash ^ (hash >> 33n)) * P2);
  hash = wrap((hash ^ (hash >> 29n)) * P3);
  return Number((hash ^ (hash >> 32n)) & 0xffffffffn);
}

/** Consume whole stripes of 32 bytes; returns the offset after them and the converged accumulators. */
function stripes(view: DataView): [number, bigint] {
  if (view.byteLength < 32) return [0, P5];
  const lanes = [wrap(P1 + P2), P2, 0n, wrap(-P1)];
  let at = 0;
  for (; at + 32 <= view.byteLength; at += 32) {
    for (let i = 0; i < 4; i++) lanes[i] = round(lanes[i], view.getBigUint64(at + 8 * i, true));
  }
  const shifts = [1n, 7n, 12n, 18n];
  const sum = wrap(lanes.reduce((total, lane, i) => total + rotate(lane, shifts[i]), 0n));
  return [at, lanes.reduce((hash, lane) => wrap((hash ^ round(0n, lane)) * P1 + P4), sum)];
}

function round(lane: bigint, input: bigint): bigint {
  return wrap(rotate(wrap(lane + input * P2), 31n) * P1);
}

function rotate(value: bigint, bits: bigint): bigint {
  return wrap((value << bits) | (value >> (64n - bits)));
}

function wrap(value: bigint): bigint {
  return BigInt.asUintN(64, value);
}
