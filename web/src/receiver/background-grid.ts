/** Cells of the background layer along one image axis, and the blur that extrapolates a view to them. */

import { weightsAround } from "./blur";

const REACH = 1.5; // extent of the layers beyond each border, as a share of a side
const GAP = 0.024; // between the border and the first cell
const FIRST_CELL = 0.015; // width of the first cell
const CELL_GROWTH = 1.7; // ratio of the widths of successive cells
const CELLS_INSIDE = 12; // along a side of the image
const BLUR = 0.03; // standard deviation of the blur at the border
const BLUR_GROWTH = 0.25; // growth of the blur per distance from the border

/** Centres, ascending, and widths of cells in normalised image units; the image is [0, 1]. */
export interface Axis {
  centres: number[];
  widths: number[];
}

/** Return uniform cells inside the image and, beyond a gap outside it, cells that grow by a constant ratio. */
export function backgroundAxis(): Axis {
  const distances: number[] = [];
  const widths: number[] = [];
  for (let edge = GAP, width = FIRST_CELL; edge < REACH; edge += width, width *= CELL_GROWTH) {
    distances.push(edge + 0.5 * width);
    widths.push(width);
  }
  const inside = Array.from({ length: CELLS_INSIDE }, (_, cell) => (cell + 0.5) / CELLS_INSIDE);
  return {
    centres: [...distances.map((distance) => -distance).reverse(), ...inside, ...distances.map((d) => 1 + d)],
    widths: [...[...widths].reverse(), ...inside.map(() => 1 / CELLS_INSIDE), ...widths],
  };
}

/** Return the weights [cell, side] of pixels along one axis: a Gaussian around the nearest point of the image. */
export function blurWeights(axis: Axis, side: number): Float64Array[] {
  return weights(axis, side, BLUR_GROWTH);
}

/** Return the same weights without growth of the blur outside the image. */
export function borderWeights(axis: Axis, side: number): Float64Array[] {
  return weights(axis, side, 0);
}

function weights({ centres }: Axis, side: number, growth: number): Float64Array[] {
  return centres.map((centre) => {
    const nearest = Math.min(Math.max(centre, 0), 1);
    const deviation = Math.max(growth * Math.abs(centre - nearest), BLUR);
    return weightsAround(nearest, deviation, side);
  });
}
