/** The self-contained page of one decoded scene, which `fecosplat decode -o scene.html` fills with Gaussians. */

import type { StoredCameras } from "../container/cameras";
import { middleOf } from "./camera-path";
import { connectNavigation } from "./navigation";
import { element, markCamera, showCameras, showNavigation, showProblem, showStatus } from "./panel";
import { SceneView } from "./scene-view";
import { drawThumbnails } from "./thumbnails";

/** Content of the element `scene`. */
interface EmbeddedScene {
  name: string;
  count: number;
  type: "ply" | "spz";
  /** Size of the coded images in pixels. */
  width: number;
  height: number;
  /** null for a file of Gaussians alone. */
  cameras: StoredCameras | null;
}

async function show(): Promise<void> {
  const scene = JSON.parse(element("scene").textContent ?? "") as EmbeddedScene;
  const gaussians = Uint8Array.from(atob(element("gaussians").textContent ?? ""), (char) => char.charCodeAt(0));
  const view = new SceneView(element<HTMLCanvasElement>("canvas"));
  const { name, count, cameras } = scene;
  connectNavigation(view, (index) => goTo(view, cameras, index));
  if (cameras) start(view, cameras);
  await view.setGaussians(gaussians, scene.type);
  if (!cameras) showWithoutCameras(view);
  showStatus(`${name}: ${count.toLocaleString("en")} Gaussians`);
  document.body.dataset.done = "true";
  if (cameras) await drawThumbnails(view, cameras, scene.width, scene.height);
}

function start(view: SceneView, cameras: StoredCameras): void {
  const first = middleOf(cameras.views);
  view.setCameras(cameras, first);
  showCameras(cameras.views.length, (index) => goTo(view, cameras, index));
  markCamera(first);
}

function goTo(view: SceneView, cameras: StoredCameras | null, index: number): void {
  const coded = cameras?.views[index];
  if (!coded) return;
  markCamera(index);
  view.goTo(coded);
}

function showWithoutCameras(view: SceneView): void {
  view.showAll();
  showNavigation();
  element("play").hidden = element("stay").hidden = true; // there are no views to pass through
}

show().catch((error: unknown) => showProblem(`This scene could not be shown: ${String(error)}`));
