/** Gaussians of the background layer: flat ones that fill cells of an image and face its view. */

import { emptyGaussians, type Gaussians, SH_DEGREE_0 } from "./gaussians";
import { type NormalisedCameras, rayThrough } from "./normalised-cameras";
import { quaternionOfMatrix } from "./quaternions";

const CELL_SCALE = 0.6; // standard deviation of a Gaussian, relative to the width of its cell
const THICKNESS = 0.3; // standard deviation along the optical axis, relative to the smaller lateral one
const OPACITY = 0.95;

/** A cell of a view, with what fills it. */
export interface Cell {
  view: number;
  /** Horizontal and vertical, in normalised image units. */
  centre: [number, number];
  widths: [number, number];
  depth: number;
  /** Red, green, blue. */
  colour: number[];
}

/** Return one Gaussian of degree 0 per cell, in the same order. */
export function facingGaussians(cells: Cell[], { views }: NormalisedCameras): Gaussians {
  const result = emptyGaussians(cells.length, 1);
  const rotations = views.map(({ rotation }) => quaternionOfMatrix(rotation));
  cells.forEach(({ view, centre, widths, depth, colour }, index) => {
    const camera = views[view];
    const ray = rayThrough(camera, ...centre);
    const lateral = [(widths[0] * CELL_SCALE) / camera.fx, (widths[1] * CELL_SCALE) / camera.fy];
    const scales = [...lateral, THICKNESS * Math.min(...lateral)];
    for (let i = 0; i < 3; i++) {
      result.means[3 * index + i] = camera.centre[i] + ray[i] * depth;
      result.scales[3 * index + i] = scales[i] * depth;
      result.harmonics[3 * index + i] = (colour[i] - 0.5) / SH_DEGREE_0;
    }
    result.rotations.set(rotations[view], 4 * index);
  });
  result.opacities.fill(OPACITY);
  return result;
}
