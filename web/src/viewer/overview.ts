/** A first view of Gaussians whose cameras are not known. */

import { Vector3 } from "three";
import type { StoredCameras } from "../container/cameras";

const FOCAL = 0.9; // relative to the height of the image
const SHARE = 0.8; // of the Gaussians, which count as the scene
const CONE = Math.PI / 4; // around the direction from the origin to the scene

/**
 * Return one camera that shows most of the points, which have the axes right, down, forward.
 *
 * It is at the origin if the scene lies ahead of it, as in a file that was written in the frame of a camera, and else in
 * front of the scene.
 */
export function overviewOf(points: Vector3[]): StoredCameras {
  const middle = new Vector3(...([0, 1, 2].map((axis) => quantile(points.map((point) => point.getComponent(axis)), 0.5)) as [number, number, number]));
  const radius = Math.max(quantile(points.map((point) => point.distanceTo(middle)), SHARE), 1e-6);
  const isAhead = quantile(points.map((point) => point.angleTo(middle)), SHARE) < CONE;
  const centre = isAhead ? new Vector3() : middle.clone().sub(new Vector3(0, 0, radius * (1 + 0.5 / FOCAL)));
  const distance = middle.distanceTo(centre);
  const forward = middle.clone().sub(centre).normalize();
  const right = new Vector3(0, 1, 0).cross(forward);
  if (right.length() < 1e-3) right.set(1, 0, 0);
  const down = forward.clone().cross(right.normalize());
  const rotation = (["x", "y", "z"] as const).flatMap((axis) => [right[axis], down[axis], forward[axis]]);
  // Their mean disparity is that of the middle.
  return { near: 0.55 * distance, far: 5.5 * distance, views: [{ rotation, centre: centre.toArray(), intrinsics: [FOCAL, FOCAL, 0.5, 0.5] }] };
}

function quantile(values: number[], share: number): number {
  return values.sort((a, b) => a - b)[Math.floor(share * (values.length - 1))];
}
