/** Pictures of the coded cameras in their buttons. */

import type { StoredCameras } from "../container/cameras";
import { addThumbnail, showProblem } from "./panel";
import type { SceneView } from "./scene-view";

export const LONGER_SIDE = 192; // pixels; shown at half that size or less, so that dense screens show them sharp

/** Return width and height of the thumbnail of an image. */
export function thumbnailSize(width: number, height: number): [number, number] {
  const scale = LONGER_SIDE / Math.max(width, height);
  return [Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale))];
}

/** Draw the Gaussians that a view shows at all coded cameras. width, height: of the coded images. */
export async function drawThumbnails(view: SceneView, cameras: StoredCameras, width: number, height: number): Promise<void> {
  let index = 0;
  try {
    for await (const picture of view.pictures(cameras.views, ...thumbnailSize(width, height))) addThumbnail(index++, picture);
  } catch (error) {
    showProblem(`The thumbnails of the cameras could not be drawn: ${String(error)}`);
  }
}
