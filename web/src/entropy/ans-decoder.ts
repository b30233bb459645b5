/** The ANS decoder (ENTROPY.md, section 2). */

import { Refusal } from "../container/refusal";
import type { Table } from "./tables";

const TWO_32 = 2 ** 32;
const SLOT_MASK = 2 ** 24 - 1;

/** Decodes entries of tables. Its state, below 2^64, is two numbers of 32 bits: high * 2^32 + low. */
export class AnsDecoder {
  private readonly words: DataView;
  private left: number;
  private high = 0;
  private low = 0;

  /** Throws Refusal unless the payload is a list of words whose last is not 0. */
  constructor(payload: Uint8Array) {
    this.words = new DataView(payload.buffer, payload.byteOffset, payload.byteLength);
    this.left = payload.length / 4;
    if (payload.length % 4 !== 0 || (this.left > 0 && this.words.getUint32(payload.length - 4, true) === 0)) {
      throw new Refusal(
        "whole words, the last not 0",
        `payload: its ${payload.length} bytes are not 32-bit words of which the last is not zero; ` +
          "the payload is damaged.",
      );
    }
    this.refill();
    this.refill();
  }

  /** Decode one entry of a table. */
  entry({ starts }: Table): number {
    const slot = this.low & SLOT_MASK;
    let below = 0;
    let above = starts.length - 1;
    while (above - below > 1) {
      const middle = (below + above) >>> 1;
      if (starts[middle] <= slot) below = middle;
      else above = middle;
    }
    this.advance(starts[below + 1] - starts[below], slot - starts[below]);
    return below;
  }

  /** Decode `count` uniform bits, 1 to 24. */
  bits(count: number): number {
    const slot = this.low & SLOT_MASK;
    const frequency = 2 ** (24 - count);
    this.advance(frequency, slot % frequency);
    return Math.floor(slot / frequency);
  }

  /** Throws Refusal unless the state is 0 and no word is left. */
  end(): void {
    if (this.high === 0 && this.low === 0 && this.left === 0) return;
    throw new Refusal(
      "state 0 and no words at the end",
      "payload: its symbols and its bytes do not end together; the payload is damaged.",
    );
  }

  /** state = (state >> 24) * frequency + rest, in products below 2^53. */
  private advance(frequency: number, rest: number): void {
    const quotient = this.high * 256 + (this.low >>> 24); // below 2^40
    const upper = Math.floor(quotient / 2 ** 20) * frequency; // weighs 2^20
    const lower = (quotient % 2 ** 20) * frequency + rest + (upper % 4096) * 2 ** 20;
    this.high = Math.floor(upper / 4096) + Math.floor(lower / TWO_32);
    this.low = lower % TWO_32;
    if (this.high === 0) this.refill();
  }

  private refill(): void {
    if (this.high !== 0 || this.left === 0) return;
    this.left -= 1;
    this.high = this.low;
    this.low = this.words.getUint32(4 * this.left, true);
  }
}
