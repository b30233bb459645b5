/** The surface that a view shows, in cells of its image, and the test of what lies behind it. */

import { type NormalisedCamera, SMALLEST_DEPTH, toCamera, toImage } from "./normalised-cameras";
import type { ViewMaps } from "./view-maps";

export const CELL = 4; // Gaussians along a side of a cell
const CLEARANCE = 1.03; // depth of a Gaussian, relative to the surface before it
const LEAST_EMITTED = 0.9; // share of the Gaussians in and around a cell that are emitted; others are cut-outs or holes
export const SMALLEST_OPACITY = 0.01; // of a Gaussian that counts as a surface
const LEAST_DISTANCE = 1; // from a camera; scenes are normalised to near = 1

/** [cell row][cell column] */
export interface ShownSurface {
  /** The farthest in and beside each cell. */
  depth: number[][];
  /** Whether nearly all Gaussians in and beside the cell are emitted. */
  isFilled: boolean[][];
}

/** maps: [height, width], multiples of 4. */
export function shownSurface({ depth, opacity }: ViewMaps, [height, width]: [number, number]): ShownSurface {
  const surface: ShownSurface = { depth: [], isFilled: [] };
  for (let top = 0; top < height; top += CELL) {
    const farthest: number[] = [];
    const isFilled: boolean[] = [];
    for (let left = 0; left < width; left += CELL) {
      const [first, end] = [Math.max(left - 1, 0), Math.min(left + CELL + 1, width)];
      let [far, emitted, count] = [0, 0, 0];
      for (let row = Math.max(top - 1, 0); row < Math.min(top + CELL + 1, height); row++) {
        for (let at = row * width + first; at < row * width + end; at++, count++) {
          if (!(opacity[at] > SMALLEST_OPACITY)) continue;
          far = Math.max(far, depth[at]);
          emitted++;
        }
      }
      farthest.push(far);
      isFilled.push(emitted / count >= LEAST_EMITTED);
    }
    surface.depth.push(farthest);
    surface.isFilled.push(isFilled);
  }
  return surface;
}

/**
 * Return whether a point is outside the image of a view or behind its surface, and not near its camera.
 *
 * Where the surface is 0, nothing is emitted, so nothing is behind it.
 */
export function isBehind({ depth }: ShownSurface, point: [number, number, number], camera: NormalisedCamera): boolean {
  const [x, y, z] = toCamera(camera, ...point);
  if (x * x + y * y + z * z < LEAST_DISTANCE ** 2) return false;
  if (!(z > SMALLEST_DEPTH)) return true;
  const [u, v] = toImage(camera, x, y, z);
  if (!(u > 0 && u < 1 && v > 0 && v < 1)) return true;
  const line = depth[Math.floor(v * depth.length)];
  const surface = line[Math.floor(u * line.length)];
  return surface > 0 && !(z < CLEARANCE * surface);
}
