/** From the predictor's Gaussians to those of the scene (FORMAT.md, section 9.1): drop, add a background, transform. */

import type { Header } from "../container/header";
import { backgroundLayer } from "./background";
import { append, type Gaussians, keep } from "./gaussians";
import type { NormalisedCameras } from "./normalised-cameras";

const LEAST_OPACITY = Math.fround(1 / 255); // renderers skip fainter Gaussians

/**
 * Return the Gaussians in the frame of the stored cameras; the background layer comes last.
 *
 * predicted: ordered (view, row, column) on the 1/2 grid, in the normalised frame. plain: their harmonics of degree 0
 * before colours by direction were fitted, [n, 3]. coverage: one bit per cell, null if all cells are covered.
 */
export function emit(
  predicted: Gaussians,
  plain: Float32Array,
  cameras: NormalisedCameras,
  header: Header,
  coverage: Uint8Array | null,
): Gaussians {
  const grid: [number, number] = [header.gridHeight / 2, header.gridWidth / 2];
  const isEmitted = new Uint8Array(predicted.count);
  for (let index = 0; index < predicted.count; index++) {
    isEmitted[index] = Number(isDrawable(predicted, index) && (!coverage || isCovered(coverage, grid[1], index)));
  }
  const opacities = predicted.opacities.map((opacity, index) => opacity * isEmitted[index]);
  const surface = { ...predicted, numHarmonics: 1, opacities, harmonics: plain };
  return toStoredFrame(append(keep(predicted, isEmitted), backgroundLayer(surface, cameras, grid)), cameras);
}

function isDrawable({ means, opacities }: Gaussians, index: number): boolean {
  const sum = means[3 * index] + means[3 * index + 1] + means[3 * index + 2]; // below the overflow of binary64
  return opacities[index] >= LEAST_OPACITY && Number.isFinite(sum);
}

/** Return whether the cell of a Gaussian is covered; a cell has 2x2 Gaussians. */
function isCovered(coverage: Uint8Array, width: number, index: number): boolean {
  const column = index % width;
  const line = Math.floor(index / width); // rows of all views
  const cell = (line >> 1) * (width / 2) + (column >> 1);
  return ((coverage[cell >> 3] >> (7 - (cell & 7))) & 1) === 1;
}

function toStoredFrame(gaussians: Gaussians, { origin, scale }: NormalisedCameras): Gaussians {
  return {
    ...gaussians,
    means: gaussians.means.map((value, at) => value * scale + origin[at % 3]),
    scales: gaussians.scales.map((value) => value * scale),
  };
}
