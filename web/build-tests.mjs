/** Bundle the tests: test/*.test.ts into build/test, test/browser/*.test.ts, their page and page-times into build/browser-tests. */

import { build } from "esbuild";
import { readdirSync, writeFileSync } from "node:fs";

const forNode = {
  outExtension: { ".js": ".mjs" },
  bundle: true,
  platform: "node",
  format: "esm",
  target: "node20",
  packages: "external",
};
const testsIn = (folder) => readdirSync(folder).filter((name) => name.endsWith(".test.ts")).map((name) => `${folder}/${name}`);

await build({ ...forNode, entryPoints: testsIn("test"), outdir: "build/test" });
await build({ ...forNode, entryPoints: [...testsIn("test/browser"), "test/browser/page-times.ts"], outdir: "build/browser-tests" });
await build({
  entryPoints: ["test/browser/vector-page.ts"],
  outfile: "build/browser-tests/vectors.js",
  bundle: true,
  format: "iife",
  target: "es2022",
});
writeFileSync("build/browser-tests/vectors.html", '<!doctype html><link rel="icon" href="data:,"><script src="vectors.js"></script>\n');
