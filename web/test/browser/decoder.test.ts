/** The decoder, and the page that decodes, in headless Chromium. */

import assert from "node:assert/strict";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { atStage, launch, open, RESULTS, saveThumbnails, settled, TIMEOUT, waitForScene } from "./chromium";
import { serve, type StaticServer } from "./static-server";

const ROOT = join(process.cwd(), "..");
const PAGE = join(ROOT, "fecocodec", "web");
const SCENE = "scene-compact-6.fcs"; // a released model's scene, 2 views of 192x128
const hasPage = existsSync(join(PAGE, "index.html"));
const needsPage = { skip: hasPage ? false : "the page that decodes was not built: no model has all graphs" };

let browser: Browser;
let server: StaticServer;

before(async () => {
  server = await serve({
    page: PAGE,
    test: join("build", "browser-tests"),
    vectors: join(ROOT, "bitstream_spec", "vectors"),
    weights: join(ROOT, "fecocodec", "weights"),
    entropy: join(ROOT, "fecocodec", "entropy"),
    scenes: join(ROOT, "bitstream_spec", "vectors", "valid"),
    views: join(RESULTS, "scenes"),
  });
  browser = await launch();
});

after(async () => {
  await browser?.close();
  server?.close();
});

test("all vectors decode to their symbols, or are refused by their rule", async () => {
  const { page } = await open(browser, `${server.url}/test/vectors.html`, 100, 100);
  await page.waitForFunction(() => window.failures !== undefined, undefined, { timeout: TIMEOUT });
  assert.deepEqual(await page.evaluate(() => window.failures), []);
  assert.ok((await page.evaluate(() => window.checked ?? 0)) > 120);
  await page.close();
});

test("a scene is decoded, shown and downloaded", needsPage, async () => {
  const { page, problems } = await open(browser, `${server.url}/page/index.html?file=/scenes/${SCENE}`, 192, 128);
  await waitForScene(page);
  await page.keyboard.press("h");
  assert.equal(await page.getAttribute("body", "data-stage"), "2");
  writeFileSync(join(RESULTS, "camera1.png"), await settled(page));
  await page.keyboard.press("2");
  writeFileSync(join(RESULTS, "camera2.png"), await settled(page));
  await page.keyboard.press("h");
  await page.setViewportSize({ width: 800, height: 600 });
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("#download")]);
  assert.equal(download.suggestedFilename(), "scene-compact-6.ply");
  await download.saveAs(join(RESULTS, "scene.ply"));
  const [spz] = await Promise.all([page.waitForEvent("download"), page.click("#download-spz")]);
  assert.equal(spz.suggestedFilename(), "scene-compact-6.spz");
  await spz.saveAs(join(RESULTS, "scene.spz"));
  writeFileSync(join(RESULTS, "facts.txt"), await page.innerText("#status"));
  await saveThumbnails(page, 2, "thumbnail");
  assert.deepEqual(problems, []);
  await page.close();
});

test("the scene of stage 1 is drawn before stage 2 is decoded", needsPage, async () => {
  const page = await browser.newPage({ viewport: { width: 192, height: 128 } });
  const preview = await atStage(page, 1);
  await page.goto(`${server.url}/page/index.html?file=/scenes/${SCENE}`);
  writeFileSync(join(RESULTS, "preview1.png"), await preview());
  await page.waitForSelector("body[data-stage='2']", { timeout: TIMEOUT });
  await page.close();
});

for (const count of [1, 3, 8, 16]) {
  test(`a file of ${count} view(s) is decoded`, needsPage, async () => {
    const { page, problems } = await open(browser, `${server.url}/page/index.html?file=/views/views-${count}.fcs`, 400, 300);
    await page.waitForSelector("body[data-done]", { timeout: TIMEOUT });
    const [download] = await Promise.all([page.waitForEvent("download"), page.click("#download")]);
    await download.saveAs(join(RESULTS, `views-${count}.ply`));
    if (count === 8) await saveThumbnails(page, count, `views-${count}-thumbnail`);
    assert.deepEqual(problems, []);
    await page.close();
  });
}

test("a file that is dropped or chosen is decoded", needsPage, async () => {
  const { page, problems } = await open(browser, `${server.url}/page/index.html`, 192, 128);
  const content = readFileSync(join(RESULTS, "scenes", "views-1.fcs"));
  await page.setInputFiles("#file", { name: "chosen.fcs", mimeType: "application/octet-stream", buffer: content });
  await page.waitForSelector("body[data-done]", { timeout: TIMEOUT });
  const dropped = await page.evaluateHandle((bytes) => {
    const transfer = new DataTransfer();
    transfer.items.add(new File([new Uint8Array(bytes)], "dropped.fcs"));
    return transfer;
  }, [...content]);
  await page.dispatchEvent("#canvas", "drop", { dataTransfer: dropped });
  await page.waitForFunction(() => /^dropped\.fcs: stage 2/.test(document.getElementById("status")!.textContent!));
  assert.deepEqual(problems, []);
  await page.close();
});

test("files on other hosts are not loaded", needsPage, async () => {
  const { page } = await open(browser, `${server.url}/page/index.html?file=http://127.0.0.1:9/a.fcs`, 800, 600);
  await page.waitForSelector("#problem:not([hidden])");
  assert.match(await page.innerText("#problem"), /a\.fcs: it cannot be fetched .* files on other hosts are not loaded/);
  await page.close();
});

test("a damaged file is explained in the page", needsPage, async () => {
  const { page } = await open(browser, `${server.url}/page/index.html?file=/vectors/faulty/header-crc-32.fcs`, 800, 600);
  await page.waitForSelector("body[data-rule]", { timeout: TIMEOUT });
  assert.equal(await page.getAttribute("body", "data-rule"), "header CRC-32");
  assert.match(await page.innerText("#problem"), /header-crc-32\.fcs: header at byte 0: CRC-32 is 0x/);
  await page.close();
});
