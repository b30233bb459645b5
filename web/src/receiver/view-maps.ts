/** Colour, depth and opacity of a view's Gaussians, as maps over its image from which layers are extrapolated. */

import { type Gaussians, SH_DEGREE_0 } from "./gaussians";
import { type NormalisedCamera, SMALLEST_DEPTH } from "./normalised-cameras";

/** Maps [height, width]; all are 0 for a Gaussian that is not finite or not in front of its camera. */
export interface ViewMaps {
  /** Red, green, blue in [0, 1]. */
  colours: Float64Array[];
  /** Along the optical axis. */
  depth: Float64Array;
  opacity: Float64Array;
}

/** gaussians: of degree 0, ordered (view, row, column), with `grid` = [height, width] per view. */
export function viewMaps(
  gaussians: Gaussians,
  camera: NormalisedCamera,
  view: number,
  [height, width]: [number, number],
): ViewMaps {
  const size = height * width;
  const [red, green, blue, depth, opacity] = Array.from({ length: 5 }, () => new Float64Array(size));
  const colours = [red, green, blue];
  for (let at = 0; at < size; at++) {
    const index = view * size + at;
    const own = depthOf(gaussians, index, camera);
    if (!(own > SMALLEST_DEPTH && Number.isFinite(own))) continue;
    depth[at] = own;
    opacity[at] = gaussians.opacities[index];
    for (let channel = 0; channel < 3; channel++) {
      const colour = 0.5 + SH_DEGREE_0 * gaussians.harmonics[3 * index + channel];
      colours[channel][at] = Math.min(Math.max(colour, 0), 1);
    }
  }
  return { colours, depth, opacity };
}

/** Return the depth of a Gaussian in its own view; NaN if its centre is not finite. */
function depthOf({ means }: Gaussians, index: number, { rotation, centre }: NormalisedCamera): number {
  return (
    (means[3 * index] - centre[0]) * rotation[2] +
    (means[3 * index + 1] - centre[1]) * rotation[5] +
    (means[3 * index + 2] - centre[2]) * rotation[8]
  );
}
