/** A stream that a reader must refuse. Rules are named as in FORMAT.md, section 12, and ENTROPY.md, section 9. */
export class Refusal extends Error {
  /** message: one sentence with location, cause and remedy. */
  constructor(
    readonly rule: string,
    message: string,
  ) {
    super(message);
    this.name = "Refusal";
  }
}

export const DAMAGED = "the file is damaged, copy or encode it again.";
export const COPY_AGAIN = "copy or download it again.";
export const BAD_WRITER = "the program that wrote it is at fault, encode the scene again.";
export const ENCODE_AGAIN = "correct the camera and encode again.";

/** Return a number as messages of the reference receiver show it. */
export function shown(value: number): string {
  if (Number.isNaN(value)) return "nan";
  if (!Number.isFinite(value)) return value > 0 ? "inf" : "-inf";
  return Number.isInteger(value) && Math.abs(value) < 1e16 ? `${Object.is(value, -0) ? "-0" : value}.0` : `${value}`;
}

export function hex(bytes: Uint8Array, separator = ""): string {
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join(separator);
}
