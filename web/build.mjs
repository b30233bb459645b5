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
const { bytesOfText } = await importedText(`${readFileSync(join("src", "viewer", "unpacking.js"), "utf8")}; export { bytesOfText };`);
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
  plugins: [{ name: "wasm-apart", setup: (plugins) => plugins.onLoad({ filter: /spark\.module\.js$/ }, withoutWasm) }],
};
let sparkWasm; // of Spark: in its program it is base64, which hardly compresses
const page = await scenePage();
// The page is tracked; versions of Node compress the same program to other bytes.
const isSame = before.includes('id="wasm"') && unpacked(before) === unpacked(page);
writeFileSync(join(output, "scene.html"), isSame ? before : page);
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
  writeFileSync(join(output, "spark.wasm"), sparkWasm);
  for (const name of ["index.html", "viewer.css", "spark.js"]) copyFileSync(join("src", "viewer", name), join(output, name));
  copyFileSync(join("node_modules", "onnxruntime-web", "dist", "ort-wasm-simd-threaded.wasm"), join(output, "ort.wasm"));
  copyFileSync(join(root, "fecocodec", "entropy", "symbol_tables.bin"), join(output, "symbol_tables.bin"));
  writeFileSync(join(output, "models.json"), JSON.stringify(models.map(copyModel)));
  writeFileSync(join(output, "licences.txt"), licences(metafile));
}

/** Return the program of Spark, which waits for its WebAssembly in `globalThis.sparkWasm`, a promise of its bytes. */
function withoutWasm({ path }) {
  const program = readFileSync(path, "utf8");
  const embedded = /const WASM = decode64\("([A-Za-z0-9+/=]+)"\)\.buffer;\s*const WASM_MODULE = WebAssembly\.compile\(WASM\);/;
  const [all, wasm] = embedded.exec(program) ?? [];
  if (!all) throw new Error(`${path}: its WebAssembly is not where it was; look how this version embeds it.`);
  sparkWasm = Buffer.from(wasm, "base64");
  return { contents: program.replace(all, "const WASM_MODULE = globalThis.sparkWasm.then(WebAssembly.compile);"), loader: "js" };
}

/** Return a page with its packed parts as bytes, one character each. */
function unpacked(page) {
  const parts = /(?<=id="(?:program|wasm|notices)">)[^<]+/g;
  return page.replace(parts, (text) => gunzipSync(bytesOfText(text)).toString("latin1"));
}

/** Return bytes after gzip compression as text: the number of padding bytes, then five characters for four bytes. */
function packed(bytes) {
  const data = gzipSync(bytes, { level: 9, memLevel: 7 });
  const padding = -data.length & 3;
  const whole = Buffer.concat([data, Buffer.alloc(padding)]);
  const codes = [48 + padding];
  for (let at = 0; at < whole.length; at += 4) {
    const word = whole.readUInt32BE(at);
    for (let power = 85 ** 4; power >= 1; power /= 85) codes.push(40 + (Math.floor(word / power) % 85));
  }
  return Buffer.from(codes.map((code) => (code === 60 ? 33 : code))).toString("latin1"); // "!" for "<"
}

/** Return the exports of a TypeScript module. */
async function imported(path) {
  const { outputFiles } = await build({ entryPoints: [path], write: false, format: "esm" });
  return importedText(outputFiles[0].contents);
}

function importedText(text) {
  return import(`data:text/javascript;base64,${Buffer.from(text).toString("base64")}`);
}

/** Return the self-contained page; Python replaces its SCENE and GAUSSIANS. */
async function scenePage() {
  const unpacking = readFileSync(join("src", "viewer", "unpacking.js"), "utf8").trim();
  const { outputFiles, metafile } = await build({ ...options, entryPoints: ["src/viewer/scene-page.ts"], write: false });
  const parts = {
    STYLE: readFileSync(join("src", "viewer", "viewer.css"), "utf8"),
    NOTICES: packed(licences(metafile)),
    WASM: packed(sparkWasm),
    PROGRAM: packed(outputFiles[0].contents),
    UNPACKING: unpacking,
  };
  const page = readFileSync(join("src", "viewer", "scene-page.html"), "utf8");
  return page.replace(/\/\*(STYLE|NOTICES|WASM|PROGRAM|UNPACKING)\*\//g, (_, name) => parts[name]);
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
