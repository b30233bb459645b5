/** Visibility test of the background layer: find the Gaussians that no context view renders. */

import { type Gaussians, meanOf } from "./gaussians";
import { type NormalisedCamera, type NormalisedCameras, SMALLEST_DEPTH, toCamera, toImage } from "./normalised-cameras";
import { matrixOfQuaternion } from "./quaternions";

const VISIBLE_DEVIATIONS = 3.2; // radius of a Gaussian; alpha is 0.6% there
const JACOBIAN_MARGIN = 0.15; // renderers evaluate the projection's Jacobian at most this share outside the image
const DEPTH_REACH = 0.5; // as a share of a side: distance outside the image up to which extended depth is used
const CLEARANCE = 0.5; // minimum distance from a camera, as a share of its view's smallest extended depth

/** Depth of a view, extrapolated to cells outside its image. */
export interface ExtendedDepth {
  /** [cell row][cell column] */
  depth: Float64Array[];
  smallest: number;
  /** Of the cells along either axis, ascending, in normalised image units. */
  centres: number[];
}

export function extendedDepth(depth: Float64Array[], centres: number[]): ExtendedDepth {
  return { depth, smallest: Math.min(...depth.map((row) => Math.min(...row))), centres };
}

/** Return whether a Gaussian is outside every image, behind the extended depth of every view, and near no camera. */
export function isHidden(
  gaussians: Gaussians,
  index: number,
  depths: ExtendedDepth[],
  cameras: NormalisedCameras,
): boolean {
  return cameras.views.every((camera, view) => isHiddenFrom(gaussians, index, depths[view], camera));
}

function isHiddenFrom(gaussians: Gaussians, index: number, extended: ExtendedDepth, camera: NormalisedCamera): boolean {
  const [x, y, z] = toCamera(camera, ...meanOf(gaussians, index));
  if (Math.sqrt(x * x + y * y + z * z) < CLEARANCE * extended.smallest) return false;
  if (!(z > SMALLEST_DEPTH)) return true;
  const uv = toImage(camera, x, y, z);
  const radius = deviations(gaussians, index, camera, uv, z).map((deviation) => VISIBLE_DEVIATIONS * deviation);
  const isSeen = uv.every((value, axis) => value > -radius[axis] && value < 1 + radius[axis]);
  return !isSeen && !(z < depthAt(extended, uv));
}

/** Return the depth of the nearest cell; 0 at more than DEPTH_REACH outside the image. */
function depthAt({ depth, centres }: ExtendedDepth, uv: number[]): number {
  if (uv.some((value) => !(value >= -DEPTH_REACH && value <= 1 + DEPTH_REACH))) return 0;
  const [column, row] = uv.map((value) => nearestCell(centres, value));
  return depth[row][column];
}

function nearestCell(centres: number[], value: number): number {
  let cell = 0;
  while (cell + 1 < centres.length && 0.5 * (centres[cell] + centres[cell + 1]) < value) cell++;
  return cell;
}

/** Return the standard deviations along u and v of the projected Gaussian, with the linearisation of renderers. */
function deviations(
  gaussians: Gaussians,
  index: number,
  camera: NormalisedCamera,
  uv: number[],
  depth: number,
): [number, number] {
  const axes = axesInCamera(gaussians, index, camera);
  const focal = [camera.fx, camera.fy];
  const principal = [camera.cx, camera.cy];
  const along = (image: 0 | 1) => {
    const clamped = Math.min(Math.max(uv[image], -JACOBIAN_MARGIN), 1 + JACOBIAN_MARGIN);
    const slope = (clamped - principal[image]) / focal[image];
    return (Math.hypot(...axes.map((axis) => axis[image] - slope * axis[2])) * focal[image]) / depth;
  };
  return [along(0), along(1)];
}

/** Return the local axes of a Gaussian, one standard deviation long, in the frame of a camera. */
function axesInCamera(gaussians: Gaussians, index: number, { rotation: r }: NormalisedCamera): number[][] {
  const [w, x, y, z] = gaussians.rotations.subarray(4 * index, 4 * index + 4);
  const m = matrixOfQuaternion(w, x, y, z);
  return [0, 1, 2].map((own) => {
    const scale = gaussians.scales[3 * index + own];
    const world = [m[own] * scale, m[3 + own] * scale, m[6 + own] * scale];
    return [0, 1, 2].map((axis) => r[axis] * world[0] + r[3 + axis] * world[1] + r[6 + axis] * world[2]);
  });
}
