/** From the predictor's Gaussians to the scene's (FORMAT.md, section 9.1): fade, drop, add a background, transform. */

import type { Stream } from "../container/stream";
import { backgroundLayer } from "./background";
import { append, type Gaussians, keep } from "./gaussians";
import type { NormalisedCameras } from "./normalised-cameras";
import { occludedLayer } from "./occluded";

const LEAST_OPACITY = Math.fround(1 / 255); // renderers skip fainter Gaussians
const MOST_VIEWS_FILLED = 8; // with more views, and for cut-outs, nothing is added behind near surfaces
const FACTORS = Float32Array.of(1, 2 / 3, 1 / 3, 0); // of opacities, by the two bits of a block of fading

/**
 * Return the Gaussians in the frame of the stored cameras; the background layer comes last, with its occluded part.
 *
 * predicted: ordered (view, row, column) on the 1/2 grid, in the normalised frame. plain: their harmonics of degree 0
 * before colours by direction were fitted, [n, 3]. stream: its coverage and fading reduce opacities.
 */
export function emit(
  predicted: Gaussians,
  plain: Float32Array,
  cameras: NormalisedCameras,
  stream: Stream,
): Gaussians {
  const grid: [number, number] = [stream.header.gridHeight / 2, stream.header.gridWidth / 2];
  const opacities = predicted.opacities.map((opacity, index) => opacity * visibility(stream, grid[1], index));
  const faded = { ...predicted, opacities };
  const isEmitted = new Uint8Array(predicted.count);
  for (let index = 0; index < predicted.count; index++) {
    isEmitted[index] = Number(isDrawable(faded, index));
  }
  const emitted = opacities.map((opacity, index) => opacity * isEmitted[index]);
  const surface = { ...predicted, numHarmonics: 1, opacities: emitted, harmonics: plain };
  const layers = [backgroundLayer(surface, cameras, grid)];
  const isFilled = !stream.coverage && cameras.views.length <= MOST_VIEWS_FILLED;
  if (isFilled) layers.push(occludedLayer(surface, cameras, grid));
  return toStoredFrame(layers.reduce(append, keep(faded, isEmitted)), cameras);
}

function isDrawable({ means, opacities }: Gaussians, index: number): boolean {
  const sum = means[3 * index] + means[3 * index + 1] + means[3 * index + 2]; // below the overflow of binary64
  return opacities[index] >= LEAST_OPACITY && Number.isFinite(sum);
}

/** Return the factor of the opacity of a Gaussian; a cell of coverage has 2x2 Gaussians, a block of fading 8x8. */
function visibility({ coverage, fading }: Stream, width: number, index: number): number {
  const column = index % width;
  const line = Math.floor(index / width); // rows of all views
  const cell = (line >> 1) * (width / 2) + (column >> 1);
  if (coverage && ((coverage[cell >> 3] >> (7 - (cell & 7))) & 1) === 0) return 0;
  if (!fading) return 1;
  const block = (line >> 3) * (width / 8) + (column >> 3);
  return FACTORS[(fading[block >> 2] >> (6 - 2 * (block & 3))) & 3];
}

function toStoredFrame(gaussians: Gaussians, { origin, scale }: NormalisedCameras): Gaussians {
  return {
    ...gaussians,
    means: gaussians.means.map((value, at) => value * scale + origin[at % 3]),
    scales: gaussians.scales.map((value) => value * scale),
  };
}
