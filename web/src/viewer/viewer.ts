/** The viewer page: opens files that are dropped, chosen or named by `?file=`. */

import { spzBytes } from "../formats/spz";
import { fetchBytes } from "./assets";
import { connectNavigation } from "./navigation";
import { OpenedFile } from "./opened-file";
import { element, showProblem, showStatus } from "./panel";
import { SceneView } from "./scene-view";

const DECODER = "decoder.js";

let waiting: Worker | null = new Worker(DECODER); // first, as it loads its networks while the view starts
const view = new SceneView(element<HTMLCanvasElement>("canvas"));
let file: OpenedFile | null = null;

function open(name: string, data: Uint8Array): void {
  file?.close();
  delete document.body.dataset.done;
  delete document.body.dataset.stage;
  file = new OpenedFile(name, data, waiting ?? new Worker(DECODER), view);
  waiting = null;
}

async function openLocal(chosen: File | undefined): Promise<void> {
  if (chosen) open(chosen.name, new Uint8Array(await chosen.arrayBuffer()));
}

async function openNamed(url: string): Promise<void> {
  showStatus(`${url}: loading`);
  try {
    open(url.split("/").at(-1) as string, await fetchBytes(url));
  } catch (error) {
    showStatus("This file could not be shown.");
    showProblem((error as Error).message);
  }
}

function save(bytes: Uint8Array<ArrayBuffer>, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([bytes]));
  link.download = name;
  link.click();
  URL.revokeObjectURL(link.href);
}

async function download(ending: "ply" | "spz"): Promise<void> {
  if (!file?.ply) return;
  const { name, ply } = file;
  try {
    save(ending === "ply" ? ply : await spzBytes(ply), `${name.replace(/\.fcs$/, "")}.${ending}`);
  } catch (error) {
    showProblem(`${name}: ${(error as Error).message}`);
  }
}

function setDropping(isDropping: boolean): void {
  document.body.classList.toggle("dropping", isDropping);
}

window.addEventListener("dragover", (event) => {
  event.preventDefault();
  setDropping(true);
});
window.addEventListener("dragleave", () => setDropping(false));
window.addEventListener("drop", (event) => {
  event.preventDefault();
  setDropping(false);
  void openLocal(event.dataTransfer?.files[0]);
});
element<HTMLInputElement>("file").addEventListener("change", (event) => {
  void openLocal((event.target as HTMLInputElement).files?.[0]);
});
element("download").addEventListener("click", () => void download("ply"));
element("download-spz").addEventListener("click", () => void download("spz"));
connectNavigation(view, (index) => file?.goTo(index));

const named = new URLSearchParams(location.search).get("file");
if (named) void openNamed(named);
void fetchBytes("licences.txt").then((text) => {
  element("licences").textContent = new TextDecoder().decode(text);
});
