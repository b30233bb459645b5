/** Blurred means over maps of a view: weights along each axis, and the two products of a map with them. */

/** Return the weights of pixels along one axis: a Gaussian around a position, in normalised image units. */
export function weightsAround(position: number, deviation: number, side: number): Float64Array {
  const row = Float64Array.from({ length: side }, (_, pixel) => {
    return Math.exp(-0.5 * (((pixel + 0.5) / side - position) / deviation) ** 2);
  });
  const total = row.reduce((sum, value) => sum + value, 0);
  return row.map((value) => value / total);
}

/**
 * Return the values [cell row][cell column] of a map [height, width], weighted along both axes.
 *
 * The height must be a multiple of 4: this many lines are added at once, which takes less than half the time.
 */
export function resampled(map: Float64Array, rows: Float64Array[], columns: Float64Array[]): Float64Array[] {
  const width = columns[0].length;
  return rows.map((row) => {
    const line = new Float64Array(width);
    for (let i = 0; i < row.length; i += 4) {
      addFourLines(line, map, i * width, row[i], row[i + 1], row[i + 2], row[i + 3]);
    }
    return Float64Array.from(columns, (column) => dot(column, line));
  });
}

function addFourLines(
  sum: Float64Array,
  map: Float64Array,
  first: number,
  a: number,
  b: number,
  c: number,
  d: number,
): void {
  const [second, third, fourth] = [1, 2, 3].map((line) => first + line * sum.length);
  for (let j = 0; j < sum.length; j++) {
    sum[j] += a * map[first + j] + b * map[second + j] + c * map[third + j] + d * map[fourth + j];
  }
}

/**
 * Return the weighted means of maps, each as `resampled`.
 *
 * weight: of each element of the maps, in addition to `rows` and `columns`. smallest: bound of the sum of the weights.
 */
export function blurredMeans(
  maps: Float64Array[],
  weight: Float64Array,
  rows: Float64Array[],
  columns: Float64Array[],
  smallest: number,
): Float64Array[][] {
  const totals = resampled(weight, rows, columns);
  return maps.map((map) => {
    const sums = resampled(product(map, weight), rows, columns);
    return sums.map((line, row) => line.map((sum, column) => sum / Math.max(totals[row][column], smallest)));
  });
}

/** Return the products of the elements of two maps. */
export function product(one: Float64Array, other: Float64Array): Float64Array {
  return one.map((value, at) => value * other[at]);
}

function dot(a: Float64Array, b: Float64Array): number {
  let sum = 0;
  for (let i = 0; i < a.length; i++) sum += a[i] * b[i];
  return sum;
}
