/** Time the page that decodes in headless Chromium: node build/browser-tests/page-times.mjs FILE.fcs [RUNS]. */

import { join, dirname, basename } from "node:path";
import { launch, open, TIMEOUT } from "./chromium";
import { serve } from "./static-server";

const [file, runs = "5"] = process.argv.slice(2);
if (!file) throw new Error("name a .fcs file");
const server = await serve({ page: join("..", "fecocodec", "web"), scenes: dirname(file) });
const address = `${server.url}/page/index.html?file=/scenes/${encodeURIComponent(basename(file))}`;
const seconds: Record<string, number[]> = { "stage 1": [], "stage 2": [] };
const steps = new Map<string, number[]>();

for (let run = 0; run < Number(runs); run++) {
  const browser = await launch(); // a new browser has no compiled code
  const { page, problems } = await open(browser, address, 768, 512, noteStates);
  await page.waitForSelector("body[data-done]", { timeout: TIMEOUT });
  const noted = await page.evaluate(() => (window as unknown as { noted: Record<string, number> }).noted);
  for (const [name, values] of Object.entries(seconds)) values.push(noted[name] / 1000);
  if (problems.length > 0) throw new Error(problems.join("\n"));
  const rows = await page.$$eval("#facts tr", (found) => found.map((row) => [...row.children].map((cell) => cell.textContent ?? "")));
  let heading = "";
  for (const cells of rows) {
    if (cells.length === 1) heading = cells[0];
    else if (cells[1].endsWith(" ms")) {
      const name = `${heading}: ${cells[0]}`;
      steps.set(name, [...(steps.get(name) ?? []), parseFloat(cells[1].replace(/,/g, ""))]);
    }
  }
  await browser.close();
}
server.close();

/** Note in the page when each stage was shown, in ms since navigation began. */
function noteStates(): void {
  const noted: Record<string, number> = {};
  (window as unknown as { noted: Record<string, number> }).noted = noted;
  new MutationObserver(() => {
    const { stage } = document.body?.dataset ?? {};
    if (stage) noted[`stage ${stage}`] ??= performance.now();
  }).observe(document, { attributes: true, subtree: true, attributeFilter: ["data-stage"] });
}

const middle = (values: number[]) => [...values].sort((a, b) => a - b)[Math.floor(values.length / 2)];
console.log(`medians of ${runs} runs, each in a new browser; drawing in software`);
for (const [name, values] of Object.entries(seconds)) console.log(`${name} shown after ${middle(values).toFixed(2)} s`);
for (const [name, values] of steps) console.log(`  ${name}: ${middle(values).toFixed(0)} ms`);
