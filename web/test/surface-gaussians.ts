/** Gaussians on surfaces before cameras, for tests. */

import { emptyGaussians, type Gaussians, SH_DEGREE_0 } from "../src/receiver/gaussians";
import { type NormalisedCamera, rayThrough } from "../src/receiver/normalised-cameras";

/** Place of a Gaussian: its index, its view, and its normalised image position. */
export interface Place {
  index: number;
  view: number;
  u: number;
  v: number;
}

/** colour: red, green, blue; grey if missing. */
export interface Point {
  depth: number;
  opacity: number;
  colour?: number[];
}

/** Return Gaussians of degree 0, ordered (view, row, column), with `grid` = [height, width] per view. */
export function surfaceGaussians(
  views: NormalisedCamera[],
  [height, width]: [number, number],
  pointAt: (place: Place) => Point,
): Gaussians {
  const gaussians = emptyGaussians(views.length * height * width, 1);
  gaussians.scales.fill(0.01);
  for (let index = 0; index < gaussians.count; index++) {
    const view = Math.floor(index / (height * width));
    const row = Math.floor(index / width) % height;
    const [u, v] = [((index % width) + 0.5) / width, (row + 0.5) / height];
    const { depth, opacity, colour = [0.5, 0.5, 0.5] } = pointAt({ index, view, u, v });
    const { centre } = views[view];
    gaussians.means.set(rayThrough(views[view], u, v).map((value, axis) => centre[axis] + depth * value), 3 * index);
    gaussians.rotations[4 * index] = 1;
    gaussians.opacities[index] = opacity;
    gaussians.harmonics.set(colour.map((value) => (value - 0.5) / SH_DEGREE_0), 3 * index);
  }
  return gaussians;
}
