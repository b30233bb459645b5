/** Cameras in the normalised frame: origin at the mean camera centre, near = 1 (FORMAT.md, section 6.4). */

import type { StoredCameras } from "../container/cameras";

const CENTRE_STEPS = 2 ** 13; // grid steps of a camera centre per near
const RATIO_BITS = 11; // significant bits of far / near

export const SMALLEST_DEPTH = 1e-6; // of a point in front of a camera

export interface NormalisedCamera {
  /** Camera-to-world rotation, row-major, OpenCV axes. */
  rotation: number[];
  centre: number[];
  /** Divided by image width (fx, cx) and height (fy, cy). */
  fx: number;
  fy: number;
  cx: number;
  cy: number;
}

/** The cameras of a scene with near = 1. A point p of this frame is the point `scale * p + origin` of the stored one. */
export interface NormalisedCameras {
  views: NormalisedCamera[];
  far: number;
  origin: number[];
  scale: number;
}

export function normalise({ near, far, views }: StoredCameras): NormalisedCameras {
  const origin = [0, 1, 2].map((axis) => sumOf(views.map(({ centre }) => centre[axis])) / views.length);
  return {
    origin,
    scale: near,
    far: roundedRatio(far / near),
    views: views.map(({ rotation, centre, intrinsics: [fx, fy, cx, cy] }) => ({
      rotation,
      centre: centre.map((value, axis) => Math.fround(rounded((value - origin[axis]) / near))),
      fx,
      fy,
      cx,
      cy,
    })),
  };
}

/** Return the point in the camera frame. */
export function toCamera({ rotation: r, centre }: NormalisedCamera, x: number, y: number, z: number): number[] {
  const [dx, dy, dz] = [x - centre[0], y - centre[1], z - centre[2]];
  return [0, 1, 2].map((axis) => r[axis] * dx + r[3 + axis] * dy + r[6 + axis] * dz);
}

/** Return the normalised image position of a point in the camera frame, in front of the camera. */
export function toImage({ fx, fy, cx, cy }: NormalisedCamera, x: number, y: number, z: number): [number, number] {
  return [(x / z) * fx + cx, (y / z) * fy + cy];
}

/** Return the direction in the world frame through a normalised image position, with depth 1. */
export function rayThrough({ rotation: r, fx, fy, cx, cy }: NormalisedCamera, u: number, v: number): number[] {
  const [x, y] = [(u - cx) / fx, (v - cy) / fy];
  return [0, 1, 2].map((row) => r[3 * row] * x + r[3 * row + 1] * y + r[3 * row + 2]);
}

function sumOf(values: number[]): number {
  return values.reduce((sum, value) => sum + value);
}

/** Round to the nearest grid point; ties round up. */
function rounded(coordinate: number): number {
  return Math.floor(CENTRE_STEPS * coordinate + 0.5) / CENTRE_STEPS;
}

/** Round to RATIO_BITS significant bits; ties round up. ratio: above 1. */
function roundedRatio(ratio: number): number {
  let unit = 2 ** (1 - RATIO_BITS);
  while (ratio >= unit * 2 ** RATIO_BITS) unit *= 2;
  return Math.floor(ratio / unit + 0.5) * unit;
}
