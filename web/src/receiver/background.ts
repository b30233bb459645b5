/**
 * Background layer: blurred Gaussians outside all context views, so that other views show no black areas there.
 *
 * The border of each view is extrapolated outwards, with more blur and larger cells at larger distances, on several
 * layers behind the surface at the border. Only candidates that no context view shows are kept. The layer is the same
 * as that of fecocodec/splatting/background.py.
 */

import { type Axis, backgroundAxis, blurWeights, borderWeights } from "./background-grid";
import { blurredMeans, product, resampled } from "./blur";
import { type Cell, facingGaussians } from "./facing";
import { type Gaussians, keep } from "./gaussians";
import { extendedDepth, isHidden } from "./hidden";
import { type NormalisedCameras, SMALLEST_DEPTH } from "./normalised-cameras";
import { type ViewMaps, viewMaps } from "./view-maps";

const DEPTH_FACTORS = [1.1, 1.8, 3.0]; // depth of each layer, relative to the blurred border depth
const SMALLEST_OPACITY = 0.01; // a border of smaller mean opacity is transparent and not extrapolated

/** A view extrapolated to cells inside and outside its image, [cell row][cell column]. */
interface Extrapolated {
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
  const views = cameras.views.map((camera, view) => extrapolated(viewMaps(gaussians, camera, view, grid), grid, axis));
  const candidates = facingGaussians(cellsOutside(views, axis), cameras);
  const depths = views.map(({ depth }) => extendedDepth(depth, axis.centres));
  const isKept = Uint8Array.from({ length: candidates.count }, (_, index) =>
    Number(isHidden(candidates, index, depths, cameras)),
  );
  return keep(candidates, isKept);
}

function extrapolated(
  { colours, depth, opacity }: ViewMaps,
  [height, width]: [number, number],
  axis: Axis,
): Extrapolated {
  const maps = [...colours, product(depth, depth)];
  const blur = [blurWeights(axis, height), blurWeights(axis, width)] as const;
  const [red, green, blue, square] = blurredMeans(maps, opacity, ...blur, SMALLEST_DEPTH);
  return {
    colours: [red, green, blue],
    depth: square.map((line) => line.map((value) => Math.max(Math.sqrt(value), SMALLEST_DEPTH))),
    opacity: resampled(opacity, borderWeights(axis, height), borderWeights(axis, width)),
  };
}

/** Return the cells outside the images, by layer, then view; none where the border is transparent. */
function cellsOutside(views: Extrapolated[], { centres, widths }: Axis): Cell[] {
  const isBeyond = centres.map((centre) => centre < 0 || centre > 1);
  const outside = centres.flatMap((_, row) =>
    centres.flatMap((_, column) => (isBeyond[row] || isBeyond[column] ? [[row, column] as const] : [])),
  );
  return DEPTH_FACTORS.flatMap((factor) =>
    views.flatMap(({ colours, depth, opacity }, view) =>
      outside
        .filter(([row, column]) => opacity[row][column] > SMALLEST_OPACITY)
        .map(([row, column]): Cell => ({
          view,
          centre: [centres[column], centres[row]],
          widths: [widths[column], widths[row]],
          depth: factor * depth[row][column],
          colour: colours.map((colour) => colour[row][column]),
        })),
    ),
  );
}
