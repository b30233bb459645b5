/** A k-d tree of distinct 3D points, for their nearest neighbours. */

const LEAF_POINTS = 12;

/** The nearest points to a query, in ascending order of distance. */
export interface Nearest {
  indices: Int32Array;
  squares: Float64Array;
}

/** Balanced tree over points [n, 3], split at the median of the widest axis. */
export class KdTree {
  private readonly order: Uint32Array;
  private readonly axes: Uint8Array;
  private readonly splits: Float64Array;

  /** points: finite and distinct; equal points would make leaves overlap and searches slow. */
  constructor(private readonly points: Float32Array) {
    const count = points.length / 3;
    this.order = Uint32Array.from({ length: count }, (_, index) => index);
    const numNodes = 4 * Math.ceil(Math.max(count, 1) / LEAF_POINTS);
    this.axes = new Uint8Array(2 * numNodes);
    this.splits = new Float64Array(2 * numNodes);
    this.build(1, 0, count);
  }

  /** Write the `nearest.indices.length` points nearest to the query, at most n, into `nearest`. */
  search(x: number, y: number, z: number, nearest: Nearest): void {
    nearest.squares.fill(Infinity);
    this.visit(1, 0, this.order.length, [x, y, z], [0, 0, 0], nearest);
  }

  private build(node: number, start: number, end: number): void {
    if (end - start <= LEAF_POINTS) return;
    const axis = this.widestAxis(start, end);
    const middle = (start + end) >>> 1;
    this.select(axis, start, end - 1, middle);
    this.axes[node] = axis;
    this.splits[node] = this.points[3 * this.order[middle] + axis];
    this.build(2 * node, start, middle);
    this.build(2 * node + 1, middle, end);
  }

  private widestAxis(start: number, end: number): number {
    const lowest = [Infinity, Infinity, Infinity];
    const highest = [-Infinity, -Infinity, -Infinity];
    for (let at = start; at < end; at++) {
      for (let axis = 0; axis < 3; axis++) {
        const value = this.points[3 * this.order[at] + axis];
        if (value < lowest[axis]) lowest[axis] = value;
        if (value > highest[axis]) highest[axis] = value;
      }
    }
    const widths = highest.map((value, axis) => value - lowest[axis]);
    return widths.indexOf(Math.max(...widths));
  }

  /** Quickselect (Hoare): afterwards no point before `middle` is greater, and none after it smaller. */
  private select(axis: number, left: number, right: number, middle: number): void {
    const { order, points } = this;
    while (left < right) {
      const pivot = points[3 * order[(left + right) >>> 1] + axis];
      let [i, j] = [left, right];
      while (i <= j) {
        while (points[3 * order[i] + axis] < pivot) i++;
        while (points[3 * order[j] + axis] > pivot) j--;
        if (i > j) break;
        [order[i], order[j]] = [order[j], order[i]];
        i++;
        j--;
      }
      if (middle <= j) right = j;
      else if (middle >= i) left = i;
      else return;
    }
  }

  /** offsets: distances of the query from the node's region along each axis. */
  private visit(node: number, start: number, end: number, query: number[], offsets: number[], nearest: Nearest): void {
    if (end - start <= LEAF_POINTS) return this.scan(start, end, query, nearest);
    const middle = (start + end) >>> 1;
    const axis = this.axes[node];
    const offset = query[axis] - this.splits[node];
    const isLeft = offset < 0;
    if (isLeft) this.visit(2 * node, start, middle, query, offsets, nearest);
    else this.visit(2 * node + 1, middle, end, query, offsets, nearest);
    const before = offsets[axis];
    offsets[axis] = offset;
    const bound = offsets[0] * offsets[0] + offsets[1] * offsets[1] + offsets[2] * offsets[2];
    if (bound < nearest.squares[nearest.squares.length - 1]) {
      if (isLeft) this.visit(2 * node + 1, middle, end, query, offsets, nearest);
      else this.visit(2 * node, start, middle, query, offsets, nearest);
    }
    offsets[axis] = before;
  }

  private scan(start: number, end: number, query: number[], { indices, squares }: Nearest): void {
    const last = squares.length - 1;
    for (let at = start; at < end; at++) {
      const index = this.order[at];
      const dx = this.points[3 * index] - query[0];
      const dy = this.points[3 * index + 1] - query[1];
      const dz = this.points[3 * index + 2] - query[2];
      const square = dx * dx + dy * dy + dz * dz;
      if (square >= squares[last]) continue;
      let slot = last;
      for (; slot > 0 && squares[slot - 1] > square; slot--) {
        squares[slot] = squares[slot - 1];
        indices[slot] = indices[slot - 1];
      }
      squares[slot] = square;
      indices[slot] = index;
    }
  }
}
