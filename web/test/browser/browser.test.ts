/** The page in headless Chromium. CHROMIUM is the path of the browser. Results go to build/browser. */

import assert from "node:assert/strict";
import { mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import { type Browser, chromium, type Page } from "playwright-core";
import { serve, type StaticServer } from "./static-server";

const ROOT = join(process.cwd(), "..");
const RESULTS = join("build", "browser");
const SCENE = "scene-compact-2.fcs"; // a released model's scene, 2 views of 192x128
const TIMEOUT = 240_000; // machines with software rendering only are slow

let browser: Browser;
let server: StaticServer;

before(async () => {
  mkdirSync(RESULTS, { recursive: true });
  server = await serve({
    page: join(ROOT, "fecocodec", "web"),
    test: join("build", "browser-tests"),
    vectors: join(ROOT, "bitstream_spec", "vectors"),
    weights: join(ROOT, "fecocodec", "weights"),
    scenes: process.env.SCENES ?? join(ROOT, "bitstream_spec", "vectors", "valid"),
  });
  browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
  });
});

after(async () => {
  await browser?.close();
  server?.close();
});

/** Open a page; returns it with the problems it has, which include requests to other hosts. */
async function open(url: string, width: number, height: number): Promise<{ page: Page; problems: string[] }> {
  const page = await browser.newPage({ viewport: { width, height } });
  page.setDefaultTimeout(TIMEOUT);
  const problems: string[] = [];
  page.on("pageerror", (error) => problems.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(message.text());
  });
  page.on("request", (request) => {
    const { protocol, origin } = new URL(request.url());
    if (origin !== server.url && !["data:", "blob:", "file:"].includes(protocol)) problems.push(request.url());
  });
  await page.goto(url);
  return { page, problems };
}

/** Wait until the file is decoded, the last scene is drawn, and the splats are sorted. */
async function waitForScene(page: Page): Promise<void> {
  await page.waitForSelector("body[data-done]", { timeout: TIMEOUT });
  await page.waitForTimeout(3000);
}

test("all vectors decode to their symbols, or are refused by their rule", async () => {
  const { page } = await open(`${server.url}/test/vectors.html`, 100, 100);
  await page.waitForFunction(() => window.failures !== undefined, undefined, { timeout: TIMEOUT });
  assert.deepEqual(await page.evaluate(() => window.failures), []);
  assert.ok((await page.evaluate(() => window.checked ?? 0)) > 120);
  await page.close();
});

test("a scene is decoded, shown and downloaded", async () => {
  const { page, problems } = await open(`${server.url}/page/index.html?file=/scenes/${SCENE}`, 192, 128);
  await waitForScene(page);
  await page.keyboard.press("h");
  assert.equal(await page.getAttribute("body", "data-stage"), "2");
  await page.screenshot({ path: join(RESULTS, "camera1.png") });
  await page.keyboard.press("2");
  await page.waitForTimeout(3000);
  await page.screenshot({ path: join(RESULTS, "camera2.png") });
  await page.keyboard.press("h");
  await page.setViewportSize({ width: 800, height: 600 });
  const [download] = await Promise.all([page.waitForEvent("download"), page.click("#download")]);
  assert.equal(download.suggestedFilename(), "scene-compact-2.ply");
  await download.saveAs(join(RESULTS, "scene.ply"));
  writeFileSync(join(RESULTS, "facts.txt"), await page.innerText("#status"));
  assert.deepEqual(problems, []);
  await page.close();
});

test("the self-contained page opens from disk", async () => {
  const { page, problems } = await open(`file://${process.cwd()}/${RESULTS}/scene.html`, 192, 128);
  await waitForScene(page);
  await page.keyboard.press("h");
  await page.screenshot({ path: join(RESULTS, "page1.png") });
  assert.deepEqual(problems, []);
  await page.close();
});

test("a damaged file is explained in the page", async () => {
  const { page } = await open(`${server.url}/page/index.html?file=/vectors/faulty/header-crc-32.fcs`, 800, 600);
  await page.waitForSelector("body[data-rule]", { timeout: TIMEOUT });
  assert.equal(await page.getAttribute("body", "data-rule"), "header CRC-32");
  assert.match(await page.innerText("#problem"), /header-crc-32\.fcs: header at byte 0: CRC-32 is 0x/);
  await page.close();
});
