/**
 * Occluded part of the background layer: Gaussians behind near surfaces, so that views from beside show no holes there.
 *
 * Where a view shows a far surface beside a near one, the far one is continued behind the near one: each cell of 8x8
 * pixels gets one Gaussian with the blurred depth and colour of the farther surfaces around it. Only Gaussians that are
 * behind what every view shows are kept. They are the same as those of fecocodec/splatting/occluded.py.
 */

import { blurredMeans, weightsAround } from "./blur";
import { type Cell, facingGaussians } from "./facing";
import { type Gaussians, keep, meanOf } from "./gaussians";
import { type NormalisedCameras, SMALLEST_DEPTH } from "./normalised-cameras";
import { CELL, isBehind, type ShownSurface, shownSurface, SMALLEST_OPACITY } from "./shown-surface";
import { type ViewMaps, viewMaps } from "./view-maps";

const BLURS = [0.03, 0.08]; // standard deviations, as fractions of the image's width; the first is preferred
const FARNESS = 8; // exponent of the depth in the weights of the blur: farther surfaces count
const SETBACK = 1.03; // depth of a Gaussian, relative to the blurred depth
const [LEAST_STEP, MOST_STEP] = [1.1, 4]; // depth of a Gaussian, relative to the surface before it
const SMALLEST_WEIGHT = 1e-30;

/** The cells of an image: their centres and, for each of BLURS, the weights of its Gaussians in each of them. */
interface CellGrid {
  rows: number[];
  columns: number[];
  weights: [rows: Float64Array[], columns: Float64Array[]][];
}

/** place: of the cell among those of all views; candidates of different blurs may have the same. */
interface Candidate extends Cell {
  place: number;
}

/**
 * Return the occluded part as Gaussians of degree 0, in the normalised frame; one per cell, of the first possible blur.
 *
 * gaussians: of degree 0, ordered (view, row, column), with `grid` = [height, width] per view, multiples of 4; opacity
 * 0 for those that are not emitted.
 */
export function occludedLayer(gaussians: Gaussians, cameras: NormalisedCameras, grid: [number, number]): Gaussians {
  const cellGrid = cellGridOf(grid);
  const views = cameras.views.map((camera, view) => {
    const maps = viewMaps(gaussians, camera, view, grid);
    const surface = shownSurface(maps, grid);
    return { surface, ofBlur: candidatesOf(maps, surface, view, cellGrid) };
  });
  const cells = BLURS.flatMap((_, blur) => views.flatMap(({ ofBlur }) => ofBlur[blur]));
  const candidates = facingGaussians(cells, cameras);
  const isKept = new Uint8Array(cells.length);
  const isTaken = new Uint8Array(gaussians.count / CELL ** 2); // by place
  cells.forEach(({ place }, index) => {
    const mean = meanOf(candidates, index);
    const isHidden = () => cameras.views.every((camera, view) => isBehind(views[view].surface, mean, camera));
    if (!isTaken[place] && isHidden()) isKept[index] = isTaken[place] = 1;
  });
  return keep(candidates, isKept);
}

function cellGridOf([height, width]: [number, number]): CellGrid {
  const [rows, columns] = [centresOf(height / CELL), centresOf(width / CELL)];
  const weights = BLURS.map((blur): [Float64Array[], Float64Array[]] => [
    rows.map((centre) => weightsAround(centre, (blur * width) / height, height)),
    columns.map((centre) => weightsAround(centre, blur, width)),
  ]);
  return { rows, columns, weights };
}

/** Return the centres of `count` equal parts of [0, 1]. */
function centresOf(count: number): number[] {
  return Array.from({ length: count }, (_, part) => (part + 0.5) / count);
}

/** Return, for each blur, the cells in which a far surface is continued behind the shown one. */
function candidatesOf(maps: ViewMaps, surface: ShownSurface, view: number, grid: CellGrid): Candidate[][] {
  const weight = farnessWeight(maps);
  const widths: [number, number] = [1 / grid.columns.length, 1 / grid.rows.length];
  return grid.weights.map((blur) => {
    const [mean, ...colours] = blurredMeans([maps.depth, ...maps.colours], weight, ...blur, SMALLEST_WEIGHT);
    return grid.rows.flatMap((y, row) =>
      grid.columns.flatMap((x, column): Candidate[] => {
        const depth = SETBACK * mean[row][column];
        if (!surface.isFilled[row][column] || !(depth > LEAST_STEP * surface.depth[row][column])) return [];
        const colour = colours.map((map) => map[row][column]);
        const place = (view * grid.rows.length + row) * grid.columns.length + column;
        const placed = Math.min(depth, MOST_STEP * surface.depth[row][column]);
        return [{ view, centre: [x, y], widths, depth: placed, colour, place }];
      }),
    );
  });
}

/** Return the weights of the Gaussians in the blur: opacity, times a power of the depth. */
function farnessWeight({ depth, opacity }: ViewMaps): Float64Array {
  const largest = depth.reduce((far, value) => Math.max(far, value), SMALLEST_DEPTH);
  return opacity.map((value, at) => (value > SMALLEST_OPACITY ? value * (depth[at] / largest) ** FARNESS : 0));
}
