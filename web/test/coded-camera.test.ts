/** Coded cameras in three.js: where points of the image are on the screen. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { PerspectiveCamera, Vector3 } from "three";
import type { StoredCamera } from "../src/container/cameras";
import { fit, placeAt } from "../src/viewer/coded-camera";
import { thumbnailSize } from "../src/viewer/thumbnails";

// Turned by 90 degrees about the vertical axis: it looks along +X. The principal point is off centre.
const CODED: StoredCamera = { rotation: [0, 0, 1, 0, 1, 0, -1, 0, 0], centre: [1, 2, 3], intrinsics: [0.9, 1.2, 0.45, 0.52] };

/** Return the normalised device coordinates of a point of the image; u, v in [0, 1] from the left and the top. */
function onScreen(camera: PerspectiveCamera, u: number, v: number): [number, number] {
  const { rotation: r, centre, intrinsics: [fx, fy, cx, cy] } = CODED;
  const ray = [(u - cx) / fx, (v - cy) / fy, 1];
  const point = new Vector3(...[0, 1, 2].map((row) => centre[row] + 2 * ray.reduce((sum, x, at) => sum + r[3 * row + at] * x, 0)));
  const { x, y } = point.project(camera);
  return [x, y];
}

function cameraOf(width: number, height: number): PerspectiveCamera {
  const camera = new PerspectiveCamera();
  placeAt(camera, CODED);
  fit(camera, CODED, width, height);
  camera.updateMatrixWorld();
  return camera;
}

function assertNear(found: number[], wanted: number[]): void {
  found.forEach((value, at) => assert.ok(Math.abs(value - wanted[at]) < 1e-5, `${found} is not ${wanted}`));
}

test("the corners of the image are the corners of a picture of its shape", () => {
  const camera = cameraOf(192, 144); // 0.9 * 192 is 1.2 * 144: square pixels
  assertNear(onScreen(camera, 0, 0), [-1, 1]);
  assertNear(onScreen(camera, 1, 1), [1, -1]);
});

test("a wider window shows the whole height of the image, and its centre in the middle", () => {
  const camera = cameraOf(384, 144);
  assertNear(onScreen(camera, 0, 0), [-0.5, 1]);
  assertNear(onScreen(camera, 1, 1), [0.5, -1]);
});

test("thumbnails keep the shape of the image", () => {
  assert.deepEqual(thumbnailSize(512, 256), [192, 96]);
  assert.deepEqual(thumbnailSize(100, 200), [96, 192]);
  assert.deepEqual(thumbnailSize(8192, 8), [192, 1]);
});
