import assert from "node:assert/strict";
import { test } from "node:test";
import { nearestNeighbours } from "../src/receiver/neighbours";

/** Return pseudorandom numbers in [0, 1). */
function numbers(count: number): Float32Array {
  let state = 1;
  return Float32Array.from({ length: count }, () => {
    state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
    return state / 2 ** 32;
  });
}

function bySearchOfAll(points: Float32Array, count: number): number[] {
  const number = points.length / 3;
  return Array.from({ length: number }, (_, query) => {
    const square = (other: number) =>
      [0, 1, 2].reduce((sum, axis) => sum + (points[3 * other + axis] - points[3 * query + axis]) ** 2, 0);
    const order = Array.from({ length: number }, (_, other) => [square(other), other]);
    return order.sort((a, b) => a[0] - b[0] || a[1] - b[1]).slice(0, count).map(([, other]) => other);
  }).flat();
}

test("the tree finds the nearest points", () => {
  const points = numbers(3 * 700);
  assert.deepEqual([...nearestNeighbours(points, 9)], bySearchOfAll(points, 9));
});

test("of coinciding points the first is the nearer one", () => {
  const points = numbers(3 * 300).map((value) => Math.floor(4 * value));
  const found = nearestNeighbours(points, 5);
  const expected = bySearchOfAll(points, 5);
  const squareOf = (indices: ArrayLike<number>, at: number) =>
    [0, 1, 2].reduce((sum, axis) => {
      return sum + (points[3 * indices[at] + axis] - points[3 * Math.floor(at / 5) + axis]) ** 2;
    }, 0);
  for (let at = 0; at < expected.length; at++) assert.equal(squareOf(found, at), squareOf(expected, at));
  for (let row = 0; row < 300; row++) {
    const own = [...found.slice(5 * row, 5 * row + 5)].filter((_, slot) => squareOf(found, 5 * row + slot) === 0);
    assert.deepEqual(own, expected.slice(5 * row, 5 * row + own.length));
  }
});

test("the work for coinciding points is bounded", () => {
  const points = new Float32Array(3 * 65536);
  points.fill(NaN, 0, 300);
  const found = nearestNeighbours(points, 17);
  assert.deepEqual([...found.slice(0, 17)], Array.from({ length: 17 }, (_, slot) => slot));
  assert.deepEqual(found.slice(-17), found.slice(0, 17));
});

test("fewer points than neighbours repeat the nearest", () => {
  assert.deepEqual([...nearestNeighbours(Float32Array.of(0, 0, 0, 1, 0, 0), 3)], [0, 1, 0, 1, 0, 1]);
});
