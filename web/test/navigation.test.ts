/** The vertical, the path through the coded cameras, and where the camera may be. */

import assert from "node:assert/strict";
import { test } from "node:test";
import { Euler, Matrix4, Quaternion, Vector3 } from "three";
import type { StoredCamera } from "../src/container/cameras";
import { CameraPath, middleOf } from "../src/viewer/camera-path";
import { overviewOf } from "../src/viewer/overview";
import { upOf } from "../src/viewer/upright";

const DEGREE = Math.PI / 180;
const TILT = new Matrix4().makeRotationFromEuler(new Euler(0.7, -1.1, 0.4));
const RING = [0, 45, 90, 135, 180, 225, 270, 315];

/** Return a camera with heading, pitch above the horizon and roll in degrees, in a world that is tilted. */
function camera([heading, pitch, roll]: number[], centre = [0, 0, 0], tilt = TILT): StoredCamera {
  const turn = new Matrix4().makeRotationFromEuler(new Euler(pitch * DEGREE, heading * DEGREE, roll * DEGREE, "YXZ"));
  const { elements: e } = tilt.clone().multiply(turn);
  return { rotation: [e[0], e[4], e[8], e[1], e[5], e[9], e[2], e[6], e[10]], centre, intrinsics: [1, 1, 0.5, 0.5] };
}

const level = (x: number) => camera([0, 0, 0], [x, 0, 0], new Matrix4());
const pathOf = (views: StoredCamera[]) => new CameraPath({ near: 1, far: 10, views }, 10);
const LOOKING_AHEAD = new Quaternion().setFromAxisAngle(new Vector3(1, 0, 0), Math.PI); // along +Z with +Y down

const CASES: Record<string, number[][]> = {
  level: [[-10, 0, 0], [0, 0, 0], [10, 0, 0]],
  "a ring that looks down": RING.map((heading) => [heading, -30, 0]),
  "one on its side": [...[-20, -5, 5, 20, 35].map((heading) => [heading, 0, 0]), [0, 0, 90]],
};
for (const [name, angles] of Object.entries(CASES)) {
  test(`the vertical of tilted cameras is recovered within a degree: ${name}`, () => {
    const up = upOf(angles.map((of) => camera(of)));
    assert.ok(up.angleTo(new Vector3(0, -1, 0).transformDirection(TILT)) < DEGREE);
  });
}

test("one camera, and cameras that look straight down, have the up direction of the first", () => {
  for (const angles of [[[20, -35, 15]], RING.map((heading) => [heading, -90, 0])]) {
    const views = angles.map((of) => camera(of));
    const { rotation: r } = views[0];
    assert.ok(upOf(views).distanceTo(new Vector3(-r[1], -r[4], -r[7])) < 1e-6);
  }
});

test("the path passes through all cameras in order and returns", () => {
  const path = pathOf([level(1), level(0), level(2)]);
  for (const [seconds, x] of [[0, 0], [2.5, 1], [5, 2], [7.5, 1], [10, 0]]) assert.ok(Math.abs(path.at(seconds).position.x - x) < 1e-6);
  assert.ok(Math.abs(path.secondsNear(new Vector3(1.1, 0, 0)) - 2.5) < 1e-6);
});

test("the path of one camera stays near it and starts there", () => {
  const path = pathOf([level(0)]);
  assert.ok(path.at(0).position.length() < 1e-9);
  for (const seconds of [0.5, 1, 2]) {
    const { position } = path.at(seconds);
    assert.ok(position.length() > 0 && position.length() < 0.5);
  }
});

test("the camera is moved back to within reach of the path, and may not look away", () => {
  const path = pathOf([level(0), level(2)]);
  const far = new Vector3(1, 0, -9);
  assert.ok(path.clamp(far));
  assert.ok(far.distanceTo(new Vector3(1, 0, -1.5)) < 1e-6); // 0.15 of the distance of the scene
  assert.equal(path.clamp(new Vector3(1, 1, 0)), false);
  assert.ok(path.sees({ position: far, quaternion: LOOKING_AHEAD }));
  assert.ok(!path.sees({ position: far, quaternion: new Quaternion() })); // backwards
});

test("the first view is the middle one", () => {
  assert.equal(middleOf([level(0), level(4), level(1)]), 2);
  assert.equal(middleOf([level(0), level(4)]), 0);
});

test("Gaussians ahead of the origin are seen from there, others from outside", () => {
  const cloud = (z: number) => Array.from({ length: 99 }, (_, at) => new Vector3(Math.sin(at), Math.cos(3 * at), z + Math.sin(7 * at)));
  assert.deepEqual(overviewOf(cloud(5)).views[0].centre, [0, 0, 0]);
  const { centre, rotation } = overviewOf(cloud(0)).views[0];
  assert.ok(centre[2] < -1.2 && rotation[8] > 0.99);
});
