/** Integer layers of the entropy model (ENTROPY.md, section 5). */

/**
 * A layer with int16 weights in Q12 and int32 biases in Q20.
 *
 * Sums are below 2^40 in magnitude, so they are exact in binary64 in any order. The weights of each group are stored in
 * blocks of four outputs, [block, input, 4], for a loop with eight accumulators.
 */
export class IntegerLayer {
  private readonly blocks: Float64Array;
  private readonly numBlocks: number;

  constructor(
    weight: Int32Array,
    private readonly bias: Int32Array,
    groups: number,
    readonly inputs: number,
    readonly outputs: number,
  ) {
    this.numBlocks = Math.ceil(outputs / 4);
    this.blocks = new Float64Array(groups * this.numBlocks * inputs * 4);
    for (let group = 0; group < groups; group++) {
      for (let k = 0; k < inputs; k++) {
        for (let o = 0; o < outputs; o++) {
          const block = group * this.numBlocks + (o >> 2);
          this.blocks[(block * inputs + k) * 4 + (o & 3)] = weight[(group * inputs + k) * outputs + o];
        }
      }
    }
  }

  /**
   * Apply the layer to rows of int16 values.
   *
   * x: [row, given]; given inputs may be fewer than those of the layer, the missing ones are 0. lowest: 0 for a relu,
   * -32768 without. Returns [row, outputs].
   */
  apply(x: Float64Array, rows: number, group: number, lowest: 0 | -32768): Float64Array {
    const given = x.length / rows;
    const result = new Float64Array(rows * this.outputs);
    for (let block = 0; block < this.numBlocks; block++) {
      const start = (group * this.numBlocks + block) * this.inputs * 4;
      const weights = this.blocks.subarray(start, start + given * 4);
      for (let row = 0; row < rows; row += 2) this.twoRows(x, row, rows, given, weights, group, block, lowest, result);
    }
    return result;
  }

  private twoRows(
    x: Float64Array,
    row: number,
    rows: number,
    given: number,
    weights: Float64Array,
    group: number,
    block: number,
    lowest: number,
    result: Float64Array,
  ): void {
    const first = row * given;
    const second = row + 1 < rows ? first + given : first;
    let [a0, a1, a2, a3, b0, b1, b2, b3] = [0, 0, 0, 0, 0, 0, 0, 0];
    for (let k = 0, w = 0; k < given; k++, w += 4) {
      const a = x[first + k];
      const b = x[second + k];
      const w0 = weights[w];
      const w1 = weights[w + 1];
      const w2 = weights[w + 2];
      const w3 = weights[w + 3];
      a0 += a * w0;
      a1 += a * w1;
      a2 += a * w2;
      a3 += a * w3;
      b0 += b * w0;
      b1 += b * w1;
      b2 += b * w2;
      b3 += b * w3;
    }
    this.store(result, row, group, 4 * block, lowest, a0, a1, a2, a3);
    if (row + 1 < rows) this.store(result, row + 1, group, 4 * block, lowest, b0, b1, b2, b3);
  }

  private store(
    result: Float64Array,
    row: number,
    group: number,
    output: number,
    lowest: number,
    s0: number,
    s1: number,
    s2: number,
    s3: number,
  ): void {
    const at = row * this.outputs + output;
    const bias = group * this.outputs + output;
    const count = this.outputs - output;
    result[at] = this.rounded(s0, bias, lowest);
    if (count > 1) result[at + 1] = this.rounded(s1, bias + 1, lowest);
    if (count > 2) result[at + 2] = this.rounded(s2, bias + 2, lowest);
    if (count > 3) result[at + 3] = this.rounded(s3, bias + 3, lowest);
  }

  private rounded(sum: number, bias: number, lowest: number): number {
    const value = Math.floor((sum + this.bias[bias] + 2048) / 4096);
    return value < lowest ? lowest : value > 32767 ? 32767 : value;
  }
}
