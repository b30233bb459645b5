/**
 * Background layer: blurred Gaussians outside all context views, so that other views show no black areas there.
 *
 * The border of each view is extrapolated outwards, with more blur and larger cells at larger distances, on several
 * layers behind the surface at the border. Only candidates that no context view shows are kept. The layer is the same
 * as that of fecocodec/receiver/background.py.
 */

import { type Axis, backgroundAxis, blurWeights, borderWeights, resampled } from "./background-grid";
import { emptyGaussians, type Gaussians, keep, SH_DEGREE_0 } from "./gaussians";
import { extendedDepth, isHidden } from "./hidden";
import { type NormalisedCamera, type NormalisedCameras, rayThrough } from "./normalised-cameras";
import { quaternionOfMatrix } from "./quaternions";

const DEPTH_FACTORS = [1.1, 1.8, 3.0]; // depth of each layer, relative to the blurred border depth
const CELL_SCALE = 0.6; // standard deviation of a Gaussian, relative to the width of its cell
const THICKNESS = 0.3; // standard deviation along the optical axis, relative to the smaller lateral one
const OPACITY = 0.95;
const SMALLEST_DEPTH = 1e-6;
const SMALLEST_OPACITY = 0.01; // a border of smaller mean opacity is transparent and not extrapolated

/** A view extrapolated to cells inside and outside its image, [cell row][cell column]. */
export interface Extrapolated {
  colours: Float64Array[][]; // red, green, blue
  depth: Float64Array[];
  /** Mean opacity at the nearest point of the image. */
  opacity: Float64Array[];
}

/**
 * Return the background layer as Gaussians of degree 0, in the normalised frame.
 *
 * gaussians: of degree 0, ordered (view, row, column), with `grid` = [height, width] per view; opacity 0 for those that
 * are not emitted.
 */
export function backgroundLayer(gaussians: Gaussians, cameras: NormalisedCameras, grid: [number, number]): Gaussians {
  const axis = backgroundAxis();
  const views = cameras.views.map((camera, view) => extrapolated(gaussians, camera, view, grid, axis));
  const candidates = candidatesOf(views, cameras, axis);
  const depths = views.map(({ depth }) => extendedDepth(depth, axis.centres));
  const isKept = Uint8Array.from(candidates.opacities, (opacity, index) =>
    Number(opacity > 0 && isHidden(candidates, index, depths, cameras)),
  );
  return keep(candidates, isKept);
}

function extrapolated(
  gaussians: Gaussians,
  camera: NormalisedCamera,
  view: number,
  [height, width]: [number, number],
  axis: Axis,
): Extrapolated {
  const maps = Array.from({ length: 5 }, () => new Float64Array(height * width)); // weight, red, green, blue, depth^2
  for (let at = 0; at < height * width; at++) {
    const index = view * height * width + at;
    const depth = depthOf(gaussians, index, camera);
    if (!(depth > SMALLEST_DEPTH && Number.isFinite(depth))) continue;
    const weight = gaussians.opacities[index];
    maps[0][at] = weight;
    for (let channel = 0; channel < 3; channel++) {
      const colour = 0.5 + SH_DEGREE_0 * gaussians.harmonics[3 * index + channel];
      maps[1 + channel][at] = weight * Math.min(Math.max(colour, 0), 1);
    }
    maps[4][at] = weight * depth * depth;
  }
  const [rows, columns] = [blurWeights(axis, height), blurWeights(axis, width)];
  const [total, red, green, blue, square] = maps.map((map) => resampled(map, rows, columns));
  const mean = (sums: Float64Array[]) =>
    sums.map((row, i) => row.map((value, j) => value / Math.max(total[i][j], SMALLEST_DEPTH)));
  return {
    colours: [red, green, blue].map(mean),
    depth: mean(square).map((row) => row.map((value) => Math.max(Math.sqrt(value), SMALLEST_DEPTH))),
    opacity: resampled(maps[0], borderWeights(axis, height), borderWeights(axis, width)),
  };
}

/** Return the depth of a Gaussian in its own view; NaN if its centre is not finite. */
function depthOf({ means }: Gaussians, index: number, { rotation, centre }: NormalisedCamera): number {
  return (
    (means[3 * index] - centre[0]) * rotation[2] +
    (means[3 * index + 1] - centre[1]) * rotation[5] +
    (means[3 * index + 2] - centre[2]) * rotation[8]
  );
}

/** Return one Gaussian per layer, view and cell outside the image, facing its view, in this order. */
function candidatesOf(views: Extrapolated[], cameras: NormalisedCameras, axis: Axis): Gaussians {
  const isBeyond = axis.centres.map((centre) => centre < 0 || centre > 1);
  const cells = axis.centres.flatMap((_, row) =>
    axis.centres.flatMap((_, column) => (isBeyond[row] || isBeyond[column] ? [[row, column] as const] : [])),
  );
  const result = emptyGaussians(DEPTH_FACTORS.length * views.length * cells.length, 1);
  let index = 0;
  for (const factor of DEPTH_FACTORS) {
    cameras.views.forEach((camera, view) => {
      const rotation = quaternionOfMatrix(camera.rotation);
      for (const [row, column] of cells) {
        writeCandidate(result, index, views[view], camera, axis, row, column, factor);
        result.rotations.set(rotation, 4 * index++);
      }
    });
  }
  return result;
}

function writeCandidate(
  result: Gaussians,
  index: number,
  view: Extrapolated,
  camera: NormalisedCamera,
  axis: Axis,
  row: number,
  column: number,
  factor: number,
): void {
  const depth = factor * view.depth[row][column];
  const ray = rayThrough(camera, axis.centres[column], axis.centres[row]);
  const lateral = [(axis.widths[column] * CELL_SCALE) / camera.fx, (axis.widths[row] * CELL_SCALE) / camera.fy];
  const scales = [...lateral, THICKNESS * Math.min(...lateral)];
  for (let i = 0; i < 3; i++) {
    result.means[3 * index + i] = camera.centre[i] + ray[i] * depth;
    result.scales[3 * index + i] = scales[i] * depth;
    result.harmonics[3 * index + i] = (view.colours[i][row][column] - 0.5) / SH_DEGREE_0;
  }
  result.opacities[index] = view.opacity[row][column] > SMALLEST_OPACITY ? OPACITY : 0;
}
