/** Nearest neighbours of 3D points, with bounded work for coinciding points (FORMAT.md, section 9.1). */

import { KdTree, type Nearest } from "./k-d-tree";

/**
 * Return the indices [n, count] of the `count` points nearest to each point; repeats the nearest if n < count.
 *
 * points: [n, 3]. Points that are not finite count as the origin. Of coinciding points, the first is the nearer one. The
 * tree holds every position once.
 */
export function nearestNeighbours(points: Float32Array, count: number): Int32Array {
  const groups = groupByPosition(finite(points));
  const tree = new KdTree(groups.positions);
  const numPoints = points.length / 3;
  const available = Math.min(count, numPoints);
  const width = Math.min(available, groups.members.length);
  const nearest = { indices: new Int32Array(width), squares: new Float64Array(width) };
  const found = new Int32Array(numPoints * count);
  groups.members.forEach((members, group) => {
    const [x, y, z] = groups.positions.subarray(3 * group, 3 * group + 3);
    tree.search(x, y, z, nearest);
    const row = firstMembers(groups.members, nearest, available);
    for (const point of members) {
      for (let slot = 0; slot < count; slot++) found[point * count + slot] = row[slot < available ? slot : 0];
    }
  });
  return found;
}

interface Groups {
  /** Of each group, [group, 3]. */
  positions: Float32Array;
  /** Indices of the points of each group, ascending. */
  members: number[][];
}

/** Return positions with 0 for values that are not finite and +0 for -0. */
function finite(points: Float32Array): Float32Array {
  return points.map((value) => (Number.isFinite(value) ? value + 0 : 0));
}

function groupByPosition(points: Float32Array): Groups {
  const groups = new Map<string, number[]>();
  for (let index = 0; index < points.length / 3; index++) {
    const key = `${points[3 * index]} ${points[3 * index + 1]} ${points[3 * index + 2]}`;
    const members = groups.get(key);
    if (members) members.push(index);
    else groups.set(key, [index]);
  }
  const members = [...groups.values()];
  const positions = new Float32Array(3 * members.length);
  members.forEach(([first], group) => positions.set(points.subarray(3 * first, 3 * first + 3), 3 * group));
  return { positions, members };
}

/** Return the first `count` points of the nearest groups, group after group. */
function firstMembers(members: number[][], { indices }: Nearest, count: number): number[] {
  const row: number[] = [];
  for (const group of indices) {
    for (const point of members[group]) {
      if (row.length === count) return row;
      row.push(point);
    }
  }
  return row;
}
