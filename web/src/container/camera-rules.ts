/** Validation of cameras (FORMAT.md, section 6.3). */

import type { StoredCamera, StoredCameras } from "./cameras";
import { ENCODE_AGAIN, Refusal, shown } from "./refusal";

const ROTATION_NAMES = ["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22"];

/** Throw Refusal for the first rule that the cameras break. place: start of messages. */
export function checkCameras(cameras: StoredCameras, place: string): void {
  checkDepths(cameras.near, cameras.far, place);
  const count = cameras.views.length;
  const camera = (view: number) => `${place}: camera ${view + 1} of ${count}`;
  cameras.views.forEach((stored, view) => checkView(stored, camera(view)));
  const mean = [0, 1, 2].map((axis) => cameras.views.reduce((sum, { centre }) => sum + centre[axis], 0) / count);
  cameras.views.forEach(({ centre }, view) => {
    if (Math.max(...centre.map((value, axis) => Math.abs(value - mean[axis]))) > 2 ** 14 * cameras.near) {
      throw new Refusal(
        "centre not too far from the mean",
        `${camera(view)}: its position is more than 16384 near from the mean position; ` +
          "correct near or the poses and encode again.",
      );
    }
  });
}

function checkDepths(near: number, far: number, place: string): void {
  for (const [name, value] of [["near", near], ["far", far]] as const) {
    if (Number.isFinite(value)) continue;
    throw new Refusal(
      "finite near, far",
      `${place}: ${name} is ${shown(value)}, it must be a finite float32 value; ` +
        "correct the depth range and encode again.",
    );
  }
  if (!(near >= 2 ** -40 && near <= 2 ** 40)) {
    throw new Refusal(
      "near within its bounds",
      `${place}: near is ${shown(near)}, it must be 2^-40 to 2^40; choose another unit of length and encode again.`,
    );
  }
  if (!(near * (1 + 2 ** -9) <= far && far <= near * 2 ** 14)) {
    throw new Refusal(
      "far / near within its bounds",
      `${place}: near is ${shown(near)} and far is ${shown(far)}, far must be 1.002 to 16384 times near; ` +
        "correct the depth range and encode again.",
    );
  }
}

function checkView({ rotation, centre, intrinsics }: StoredCamera, camera: string): void {
  checkFinite(rotation, centre, intrinsics, camera);
  if (rotation.some((value) => Math.abs(value) > 2) || orthonormalityError(rotation) > 0.001) {
    throw new Refusal(
      "rotation orthonormal",
      `${camera}: its rotation is not orthonormal within 0.001; give a rigid pose without scale and encode again.`,
    );
  }
  if (determinant(rotation) < 0) {
    throw new Refusal(
      "not mirrored",
      `${camera}: its pose is mirrored (determinant below 0); give OpenCV camera-to-world poses and encode again.`,
    );
  }
  if (centre.some((value) => Math.abs(value) > 2 ** 60)) {
    throw new Refusal(
      "centre not too far",
      `${camera}: its position is more than 2^60 from the origin; choose another unit of length and encode again.`,
    );
  }
  checkIntrinsics(intrinsics, camera);
}

function checkFinite(rotation: number[], centre: number[], intrinsics: number[], camera: string): void {
  const values = [...rotation, ...centre, ...intrinsics];
  const names = [...ROTATION_NAMES, "tx", "ty", "tz", "fx", "fy", "cx", "cy"];
  const at = values.findIndex((value) => !Number.isFinite(value));
  if (at < 0) return;
  throw new Refusal(
    "finite camera values",
    `${camera}: ${names[at]} is ${shown(values[at])}, it must be a finite float32 value; ${ENCODE_AGAIN}`,
  );
}

function checkIntrinsics(intrinsics: number[], camera: string): void {
  for (const [at, name] of ["fx", "fy"].entries()) {
    if (intrinsics[at] >= 2 ** -6 && intrinsics[at] <= 2 ** 8) continue;
    throw new Refusal(
      "focal lengths",
      `${camera}: focal length ${name} is ${shown(intrinsics[at])} image sides, it must be 2^-6 to 2^8; ` +
        "correct it and encode again.",
    );
  }
  for (const [at, name] of ["cx", "cy"].entries()) {
    if (Math.abs(intrinsics[2 + at]) <= 2 ** 8) continue;
    throw new Refusal(
      "principal point",
      `${camera}: principal point ${name} is ${shown(intrinsics[2 + at])} image sides, at most 2^8 may be; ` +
        "correct it and encode again.",
    );
  }
}

/** Return the largest magnitude of an element of R R^T - I. */
function orthonormalityError(r: number[]): number {
  let largest = 0;
  for (let i = 0; i < 3; i++) {
    for (let j = 0; j < 3; j++) {
      const product = r[3 * i] * r[3 * j] + r[3 * i + 1] * r[3 * j + 1] + r[3 * i + 2] * r[3 * j + 2];
      largest = Math.max(largest, Math.abs(product - (i === j ? 1 : 0)));
    }
  }
  return largest;
}

function determinant([a, b, c, d, e, f, g, h, i]: number[]): number {
  return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
}
