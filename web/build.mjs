/** Build the viewer page: node build.mjs OUTPUT_FOLDER. Run by `make web`. */

import { build } from "esbuild";
import { createHash } from "node:crypto";
import { copyFileSync, existsSync, mkdirSync, readdirSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { gunzipSync, gzipSync } from "node:zlib";

const output = process.argv[2];
if (!output) throw new Error("usage: node build.mjs OUTPUT_FOLDER");
const root = join(import.meta.dirname, "..");
const { GRAPHS } = await imported("src/receiver/graph-names.ts");
const weights = join(root, "fecocodec", "weights");

const before = existsSync(join(output, "scene.html")) ? readFileSync(join(output, "scene.html"), "utf8") : "";
rmSync(output, { recursive: true, force: true });
mkdirSync(output, { recursive: true });
const options = {
  bundle: true,
  minify: true,
  format: "iife",
  target: "es2022",
  legalComments: "none", // the pages have the notices
  metafile: true,
  define: { "import.meta.url": "self.location.href" },
};
const page = await scenePage();
// The page is tracked; versions of Node compress the same program to other bytes.
writeFileSync(join(output, "scene.html"), unpacked(before) === unpacked(page) ? before : page);
const models = modelsWithGraphs();
if (models.length > 0) await decoderPage();
else console.log("no model has all graphs of the receiver: the page that decodes in the browser is left out");

/** Write the page that decodes in the browser, with its decoder and models. */
async function decoderPage() {
  const { metafile } = await build({
    ...options,
    entryPoints: { viewer: "src/viewer/viewer.ts", decoder: "src/viewer/decoder-worker.ts" },
    outdir: output,
  });
  for (const name of ["index.html", "viewer.css"]) copyFileSync(join("src", "viewer", name), join(output, name));
  copyFileSync(join("node_modules", "onnxruntime-web", "dist", "ort-wasm-simd-threaded.wasm"), join(output, "ort.wasm"));
  copyFileSync(join(root, "fecocodec", "entropy", "symbol_tables.bin"), join(output, "symbol_tables.bin"));
  writeFileSync(join(output, "models.json"), JSON.stringify(models.map(copyModel)));
  writeFileSync(join(output, "licences.txt"), licences(metafile));
}

/** Return a page with its program decompressed. */
function unpacked(page) {
  const isProgram = /H4sI[A-Za-z0-9+/=]{1000,}/;
  return page.replace(isProgram, (data) => gunzipSync(Buffer.from(data, "base64")).toString("utf8"));
}

/** Return the exports of a TypeScript module. */
async function imported(path) {
  const { outputFiles } = await build({ entryPoints: [path], write: false, format: "esm" });
  return import(`data:text/javascript;base64,${Buffer.from(outputFiles[0].contents).toString("base64")}`);
}

/** Return the self-contained page; Python replaces its SCENE and GAUSSIANS. */
async function scenePage() {
  const { outputFiles, metafile } = await build({ ...options, entryPoints: ["src/viewer/scene-page.ts"], write: false });
  const parts = {
    STYLE: readFileSync(join("src", "viewer", "viewer.css"), "utf8"),
    NOTICES: licences(metafile),
    PROGRAM: gzipSync(outputFiles[0].contents, { level: 9 }).toString("base64"),
  };
  const page = readFileSync(join("src", "viewer", "scene-page.html"), "utf8");
  return Object.entries(parts).reduce((text, [name, part]) => text.replace(`/*${name}*/`, () => part), page);
}

/** Return the folders of the models whose receiver is exported as a whole. */
function modelsWithGraphs() {
  const folders = readdirSync(weights).map((name) => join(weights, name));
  return folders.filter((folder) => existsSync(join(folder, "graphs", "attend.onnx")));
}

/** Copy the weights and graphs of a model; returns its model id. */
function copyModel(folder) {
  const receiver = readFileSync(join(folder, "receiver.safetensors"));
  const id = createHash("sha256").update(receiver).digest("hex").slice(0, 16);
  const target = join(output, "models", id);
  mkdirSync(target, { recursive: true });
  writeFileSync(join(target, "receiver.safetensors"), receiver);
  for (const name of GRAPHS) copyFileSync(join(folder, "graphs", `${name}.onnx`), join(target, `${name}.onnx`));
  return id;
}

/** Return the licence texts of the packages that were bundled. */
function licences(metafile) {
  const inputs = Object.keys(metafile.inputs).filter((path) => path.startsWith("node_modules/"));
  const names = new Set(inputs.map((path) => /^node_modules\/((?:@[^/]+\/)?[^/]+)/.exec(path)[1]));
  const own = `FeCoSplat, Apache-2.0\n\n${readFileSync(join(root, "LICENSE"), "utf8").trim()}`;
  return [...[...names].sort().map(notice), own].join("\n\n");
}

function notice(name) {
  const folder = join("node_modules", name);
  const { version, license } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
  const file = readdirSync(folder).find((entry) => /^licen[cs]e/i.test(entry));
  const text = file ? readFileSync(join(folder, file), "utf8").trim() : "";
  return `${name} ${version}, ${license}\n\n${text}`.trim();
}
