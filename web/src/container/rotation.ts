/** Rotations of the camera section: differences from predictions (FORMAT.md, section 6.2). */

const WORD = new DataView(new ArrayBuffer(4));

/** Return the float32 value of 32 bits. */
export function floatOfBits(bits: number): number {
  WORD.setUint32(0, bits);
  return WORD.getFloat32(0);
}

/** Return the rotation matrix, row-major, of nine words. */
export function rotationOfWords(words: number[]): number[] {
  const [r20, r21, r10] = words.slice(0, 3).map(floatOfBits);
  const r22 = addDifference(words[3], root(1 - r20 * r20 - r21 * r21));
  const r00 = addDifference(words[4], root(1 - r20 * r20 - r10 * r10));
  const r01 = addDifference(words[5], -ratio(r10 * r22 + r00 * r20 * r21, r00 * r00 + r10 * r10));
  const r11 = addDifference(words[6], ratio(r00 * r22 - r10 * r20 * r21, r00 * r00 + r10 * r10));
  const r02 = addDifference(words[7], r10 * r21 - r20 * r11);
  const r12 = addDifference(words[8], r20 * r01 - r00 * r21);
  return [r00, r01, r02, r10, r11, r12, r20, r21, r22];
}

function addDifference(word: number, prediction: number): number {
  const bits = bitsOfPrediction(prediction);
  const z = word >>> 1;
  const m = z % 2 === 0 ? z / 2 : -(z + 1) / 2;
  const magnitude = ((bits & 0x7fffffff) + m) & 0x7fffffff;
  const sign = (bits >>> 31) ^ (word & 1);
  return floatOfBits(((sign << 31) | magnitude) >>> 0);
}

function bitsOfPrediction(prediction: number): number {
  if (Number.isNaN(prediction) || Math.abs(prediction) > 1.5) return 0;
  WORD.setFloat32(0, prediction);
  const bits = WORD.getUint32(0);
  return bits === 0x80000000 ? 0 : bits;
}

function root(x: number): number {
  return x > 0 ? Math.sqrt(x) : 0;
}

function ratio(a: number, b: number): number {
  return b > 0 ? a / b : 0;
}
