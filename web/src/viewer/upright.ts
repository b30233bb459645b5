/** The vertical of a scene, estimated from its cameras as fecocodec/geometry/upright.py does. */

import { Matrix3, Vector3 } from "three";
import type { StoredCamera } from "../container/cameras";

const ROLL = 0.09; // radians: cameras rolled further than this about their optical axis count less and less
const TILT_WEIGHT = 0.007; // cameras look up and down freely, but are hardly rolled
const LEAST_AGREEMENT = 0.17; // length of the mean image-up axis
const STEPS = 10;
const SOLVES = 100; // of inverse iteration

/** Return the unit vector that points up; that of the first camera if the cameras do not agree on one. */
export function upOf(cameras: StoredCamera[]): Vector3 {
  const rights = cameras.map(({ rotation: r }) => new Vector3(r[0], r[3], r[6]));
  const upward = cameras.map(({ rotation: r }) => new Vector3(-r[1], -r[4], -r[7]));
  if (mean(upward, upward.map(() => 1)).length() < LEAST_AGREEMENT) return upward[0];
  const typical = sphericalMedian(upward);
  let axis = typical;
  for (let step = 0; step < STEPS; step++) {
    const weights = rights.map((right) => 1 / (1 + (right.dot(axis) / ROLL) ** 2));
    axis = leastAxis(rights, weights, typical);
  }
  return axis;
}

/** Return the unit vector with the least sum of distances to the others (Weiszfeld 1937), starting at their mean. */
function sphericalMedian(units: Vector3[]): Vector3 {
  let median = mean(units, units.map(() => 1)).normalize();
  for (let step = 0; step < STEPS; step++) {
    median = mean(units, units.map((unit) => 1 / Math.max(unit.distanceTo(median), ROLL))).normalize();
  }
  return median;
}

/** Return the axis across the right axes and near the typical one: the eigenvector with the least eigenvalue. */
function leastAxis(rights: Vector3[], weights: number[], typical: Vector3): Vector3 {
  const total = weights.reduce((sum, weight) => sum + weight, 0);
  const margin = TILT_WEIGHT * (1 + 1e-6); // makes the matrix positive definite
  const at = (row: number, column: number) => {
    const rolls = rights.reduce((sum, right, view) => sum + weights[view] * right.getComponent(row) * right.getComponent(column), 0);
    const tilt = TILT_WEIGHT * typical.getComponent(row) * typical.getComponent(column);
    return rolls / total - tilt + (row === column ? margin : 0);
  };
  const matrix = new Matrix3(at(0, 0), at(0, 1), at(0, 2), at(1, 0), at(1, 1), at(1, 2), at(2, 0), at(2, 1), at(2, 2));
  const inverse = matrix.invert();
  const axis = typical.clone();
  for (let solve = 0; solve < SOLVES; solve++) axis.applyMatrix3(inverse).normalize();
  return axis.dot(typical) < 0 ? axis.negate() : axis;
}

function mean(vectors: Vector3[], weights: number[]): Vector3 {
  const total = weights.reduce((sum, weight) => sum + weight, 0);
  return vectors.reduce((sum, vector, at) => sum.addScaledVector(vector, weights[at] / total), new Vector3());
}
