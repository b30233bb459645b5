/** Buttons and keys that move the camera and hide the panel. */

import { element } from "./panel";
import type { Navigation, SceneView } from "./scene-view";

const HINTS: Record<Navigation, string> = {
  orbit: "Drag to orbit, wheel or two fingers to zoom.",
  fly: "W A S D to move, drag to look.",
};
const EDGE = "The views show no more from here. Switch off \u201cStay near\u201d to go on.";
const EDGE_MS = 3000;

/** Connect the controls of the page with a view. goTo: move to a coded camera by index. */
export function connectNavigation(view: SceneView, goTo: (index: number) => void): void {
  let navigation: Navigation = "orbit";
  let isPlaying = false;
  let edge: ReturnType<typeof setTimeout> | undefined;
  const showHint = (text: string) => (element("hint").textContent = text);
  const setNavigation = (next: Navigation) => {
    navigation = next;
    view.stop();
    view.setNavigation(next);
    press("mode", next === "fly");
    showHint(HINTS[next]);
  };
  const toggle = () => setNavigation(navigation === "fly" ? "orbit" : "fly");
  const play = () => (isPlaying ? view.stop() : view.play());
  const stay = () => view.setStaysNear(press("stay", element("stay").getAttribute("aria-pressed") !== "true"));
  view.listener = {
    onEdge: () => {
      clearTimeout(edge);
      showHint(EDGE);
      edge = setTimeout(() => showHint(HINTS[navigation]), EDGE_MS);
    },
    onPlaying: (next) => (isPlaying = press("play", next)),
  };
  element("mode").addEventListener("click", toggle);
  element("play").addEventListener("click", play);
  element("stay").addEventListener("click", stay);
  showHint(HINTS[navigation]);
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (/^[1-9]$/.test(event.key)) goTo(Number(event.key) - 1);
    else if (event.key === "o") toggle();
    else if (event.key === "p") play();
    else if (event.key === "n") stay();
    else if (event.key === "h") element("panel").classList.toggle("hidden");
  });
}

/** Show a button as pressed or not; returns which. */
function press(id: string, isPressed: boolean): boolean {
  element(id).setAttribute("aria-pressed", String(isPressed));
  return isPressed;
}
