/** The panel of the page: status, problems, facts about the file, camera buttons. Texts are set, never parsed as HTML. */

import type { Timing } from "../decoder";
import type { Summary } from "./messages";

export function element<Kind extends HTMLElement>(id: string): Kind {
  const found = document.getElementById(id);
  if (!found) throw new Error(`the page has no element ${id}.`);
  return found as Kind;
}

export function showStatus(text: string): void {
  element("status").textContent = text;
}

/** Show a sentence about a problem; an empty one hides it. */
export function showProblem(text: string): void {
  element("problem").textContent = text;
  element("problem").hidden = text === "";
}

/** Make one button for each coded camera. */
export function showCameras(count: number, onChoice: (index: number) => void): void {
  const buttons = Array.from({ length: count }, (_, index) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = `View ${index + 1}`;
    button.addEventListener("click", () => onChoice(index));
    return button;
  });
  element("cameras").replaceChildren(...buttons);
  element("cameras").hidden = false;
  showNavigation();
}

/** Show the buttons that move the camera. */
export function showNavigation(): void {
  element("navigation").hidden = false;
}

/** Show what a coded camera sees in its button. */
export function addThumbnail(index: number, picture: ImageData): void {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [picture.width, picture.height];
  canvas.getContext("2d")?.putImageData(picture, 0, 0);
  canvas.setAttribute("aria-hidden", "true"); // the text of the button names the camera
  element("cameras").children[index].prepend(canvas);
}

export function markCamera(index: number): void {
  [...element("cameras").children].forEach((button, at) => button.setAttribute("aria-current", String(at === index)));
}

/** The table of facts about a file, filled while it is decoded. */
export class Facts {
  constructor(private readonly table: HTMLTableElement) {
    table.replaceChildren();
    element("details").hidden = false;
  }

  addSummary(summary: Summary): void {
    this.heading("File");
    this.row("size", bytesText(summary.bytes));
    this.row("views", `${summary.cameras.views.length} of ${summary.width}x${summary.height}`);
    this.row("format, model", `${summary.version}, ${summary.modelId}`);
    this.heading("Bytes by section");
    for (const [name, bytes] of summary.parts) this.row(name, bytesText(bytes));
  }

  addStep(step: string, ms: number): void {
    this.row(step, `${ms.toFixed(0)} ms`);
  }

  addStage(stage: number, count: number, timings: Timing[]): void {
    this.heading(`Stage ${stage}`);
    this.row("Gaussians", count.toLocaleString("en"));
    for (const { step, ms } of timings) this.addStep(step, ms);
  }

  heading(text: string): void {
    const cell = document.createElement("th");
    cell.textContent = text;
    this.table.insertRow().append(cell);
  }

  private row(name: string, value: string): void {
    const row = this.table.insertRow();
    row.insertCell().textContent = name;
    row.insertCell().textContent = value;
  }
}

function bytesText(bytes: number): string {
  return `${bytes.toLocaleString("en")} bytes`;
}
