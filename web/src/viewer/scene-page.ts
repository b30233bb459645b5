/** The self-contained page of one decoded scene, which `fecosplat decode -o scene.html` fills with Gaussians. */

import type { StoredCameras } from "../container/cameras";
import { connectNavigation } from "./navigation";
import { element, markCamera, showCameras, showProblem, showStatus } from "./panel";
import { SceneView } from "./scene-view";
import { drawThumbnails } from "./thumbnails";

/** Content of the element `scene`. */
interface EmbeddedScene {
  name: string;
  count: number;
  /** Size of the coded images in pixels. */
  width: number;
  height: number;
  cameras: StoredCameras;
}

async function show(): Promise<void> {
  const { name, count, width, height, cameras } = JSON.parse(element("scene").textContent ?? "") as EmbeddedScene;
  const gaussians = Uint8Array.from(atob(element("gaussians").textContent ?? ""), (char) => char.charCodeAt(0));
  const view = new SceneView(element<HTMLCanvasElement>("canvas"));
  const goTo = (index: number) => {
    if (!cameras.views[index]) return;
    markCamera(index);
    view.goTo(cameras.views[index]);
  };
  view.setCameras(cameras);
  showCameras(cameras.views.length, goTo);
  markCamera(0);
  connectNavigation(view, goTo);
  await view.setGaussians(gaussians, "spz");
  showStatus(`${name}: ${count.toLocaleString("en")} Gaussians`);
  document.body.dataset.done = "true";
  await drawThumbnails(view, cameras, width, height);
}

element("licences").textContent = element("notices").textContent;
show().catch((error: unknown) => showProblem(`This scene could not be shown: ${String(error)}`));
