/** Buttons and keys that move the camera and hide the panel. */

import { element } from "./panel";
import type { Navigation, SceneView } from "./scene-view";

const HINTS: Record<Navigation, string> = {
  orbit: "Drag to orbit, wheel or two fingers to zoom.",
  fly: "W A S D to move, drag to look.",
};

/** Connect the controls of the page with a view. goTo: move to a coded camera by index. */
export function connectNavigation(view: SceneView, goTo: (index: number) => void): void {
  let navigation: Navigation = "orbit";
  const setNavigation = (next: Navigation) => {
    navigation = next;
    view.setNavigation(next);
    element("mode").setAttribute("aria-pressed", String(next === "fly"));
    element("hint").textContent = HINTS[next];
  };
  const toggle = () => setNavigation(navigation === "fly" ? "orbit" : "fly");
  element("mode").addEventListener("click", toggle);
  element("hint").textContent = HINTS[navigation];
  window.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (/^[1-9]$/.test(event.key)) goTo(Number(event.key) - 1);
    else if (event.key === "o") toggle();
    else if (event.key === "h") element("panel").classList.toggle("hidden");
  });
}
