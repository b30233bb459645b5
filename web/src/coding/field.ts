/** Arrays of integer vectors on the grids of all views, and the gathering of inputs of layers (ENTROPY.md, section 5). */

/** Values [view, row, column, channel] as integers, in Q8 for latents. */
export interface Field {
  values: Float64Array;
  views: number;
  rows: number;
  columns: number;
  channels: number;
}

/** Positions in the order of a batch: views, rows and columns. */
export interface Positions {
  count: number;
  view: Int32Array;
  row: Int32Array;
  column: Int32Array;
}

export type Offsets = readonly (readonly [number, number])[];

/** The 3x3 neighbourhood, row by row. */
export const AROUND: Offsets = [-1, 0, 1].flatMap((a) => [-1, 0, 1].map((b) => [a, b] as const));
export const HERE: Offsets = [[0, 0]];

export function emptyField(views: number, rows: number, columns: number, channels: number): Field {
  return { values: new Float64Array(views * rows * columns * channels), views, rows, columns, channels };
}

/** Return the positions of all views, row by row, for which the predicate holds. */
export function positionsOf(
  views: number,
  rows: number,
  columns: number,
  isIncluded: (row: number, column: number) => boolean,
): Positions {
  const found: [number, number][] = [];
  for (let row = 0; row < rows; row++) {
    for (let column = 0; column < columns; column++) if (isIncluded(row, column)) found.push([row, column]);
  }
  const count = views * found.length;
  const at = (of: (index: number) => number) => Int32Array.from({ length: count }, (_, index) => of(index));
  return {
    count,
    view: at((index) => Math.floor(index / found.length)),
    row: at((index) => found[index % found.length][0]),
    column: at((index) => found[index % found.length][1]),
  };
}

/** Input of a layer: rows of vectors, one for each position, filled part by part from left to right. */
export class Inputs {
  readonly values: Float64Array;
  private filled = 0;

  constructor(
    private readonly positions: Positions,
    private readonly channels: number,
  ) {
    this.values = new Float64Array(positions.count * channels);
  }

  /** Append the vectors of a field at offsets from the positions, clipped to int16; zeros outside the field. */
  add(field: Field, offsets: Offsets): this {
    for (const [a, b] of offsets) this.addOne(field, a, b);
    return this;
  }

  /** Append the same values to every row. */
  addConstant(values: readonly number[]): this {
    for (let row = 0; row < this.positions.count; row++) {
      values.forEach((value, at) => (this.values[row * this.channels + this.filled + at] = value));
    }
    this.filled += values.length;
    return this;
  }

  /** Append the vectors of a field at the positions, without clipping. */
  addExact({ values, rows, columns, channels }: Field): this {
    const { view, row, column, count } = this.positions;
    for (let position = 0; position < count; position++) {
      const from = ((view[position] * rows + row[position]) * columns + column[position]) * channels;
      this.values.set(values.subarray(from, from + channels), position * this.channels + this.filled);
    }
    this.filled += channels;
    return this;
  }

  private addOne(field: Field, a: number, b: number): void {
    const { view, row, column, count } = this.positions;
    const { rows, columns, channels, values } = field;
    for (let position = 0; position < count; position++) {
      const i = row[position] + a;
      const j = column[position] + b;
      if (i < 0 || j < 0 || i >= rows || j >= columns) continue;
      const from = ((view[position] * rows + i) * columns + j) * channels;
      const to = position * this.channels + this.filled;
      for (let c = 0; c < channels; c++) {
        const value = values[from + c];
        this.values[to + c] = value < -32768 ? -32768 : value > 32767 ? 32767 : value;
      }
    }
    this.filled += channels;
  }
}

/** Return a field of twice the rows and columns and a quarter of the channels (`double` of ENTROPY.md). */
export function doubled(field: Field): Field {
  const quarter = field.channels / 4;
  const result = emptyField(field.views, 2 * field.rows, 2 * field.columns, quarter);
  let from = 0;
  for (let line = 0; line < field.views * field.rows; line++) {
    for (let column = 0; column < field.columns; column++) {
      for (let phase = 0; phase < 4; phase++, from += quarter) {
        const to = ((2 * line + (phase >> 1)) * 2 * field.columns + 2 * column + (phase & 1)) * quarter;
        result.values.set(field.values.subarray(from, from + quarter), to);
      }
    }
  }
  return result;
}
