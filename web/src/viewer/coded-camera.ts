/** Coded cameras (OpenCV axes, any principal point) as cameras of three.js. */

import { Matrix4, PerspectiveCamera, Vector3 } from "three";
import type { StoredCamera } from "../container/cameras";

/** Move a camera to a coded one. */
export function placeAt(camera: PerspectiveCamera, { rotation: r, centre }: StoredCamera): void {
  // Columns are right, up and backward; OpenCV has right, down and forward.
  const pose = new Matrix4().set(
    r[0], -r[1], -r[2], centre[0],
    r[3], -r[4], -r[5], centre[1],
    r[6], -r[7], -r[8], centre[2],
    0, 0, 0, 1,
  );
  pose.decompose(camera.position, camera.quaternion, new Vector3());
}

/** Set field of view and principal point so that the window shows the whole image of a coded camera, and no less. */
export function fit(
  camera: PerspectiveCamera,
  { intrinsics: [fx, fy, cx, cy] }: StoredCamera,
  width: number,
  height: number,
): void {
  const aspect = width / height;
  const tangent = Math.max(0.5 / fy, 0.5 / fx / aspect); // of half the vertical field of view
  camera.aspect = aspect;
  camera.fov = (360 / Math.PI) * Math.atan(tangent);
  const imageHeight = (height * 0.5) / fy / tangent;
  const imageWidth = (imageHeight * fy) / fx;
  camera.setViewOffset(width, height, (0.5 - cx) * imageWidth, (0.5 - cy) * imageHeight, width, height);
}
