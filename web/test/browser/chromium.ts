/** Headless Chromium for the tests. The variable CHROMIUM has the path of the browser. */

import { mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { type Browser, chromium, type Page } from "playwright-core";

/** Screenshots and downloads, which test_results.py compares with the Python receiver. */
export const RESULTS = join("build", "browser");
export const TIMEOUT = 240_000; // machines with software rendering only are slow

export async function launch(): Promise<Browser> {
  mkdirSync(RESULTS, { recursive: true });
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
  });
}

/**
 * Open a page; returns it with its problems, which include errors, and requests to other hosts than that of `url`.
 *
 * first: runs in the page before its own scripts.
 */
export async function open(
  browser: Browser,
  url: string,
  width: number,
  height: number,
  first: () => void = () => undefined,
): Promise<{ page: Page; problems: string[] }> {
  const page = await browser.newPage({ viewport: { width, height } });
  page.setDefaultTimeout(TIMEOUT);
  const problems: string[] = [];
  page.on("pageerror", (error) => problems.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(message.text());
  });
  page.on("request", (request) => {
    const { protocol, origin } = new URL(request.url());
    if (origin !== new URL(url).origin && !["data:", "blob:"].includes(protocol)) problems.push(request.url());
  });
  await page.addInitScript(first);
  await page.goto(url);
  return { page, problems };
}

/** Prepare a page to keep its picture at the moment a stage is shown; returns a function that waits for it, as PNG. */
export async function atStage(page: Page, stage: number): Promise<() => Promise<Buffer>> {
  await page.addInitScript((wanted) => {
    const keep = () => {
      if (document.body?.dataset.stage !== wanted) return;
      (window as unknown as { kept: string }).kept ??= document.querySelector("canvas")!.toDataURL("image/png");
    };
    new MutationObserver(keep).observe(document, { attributes: true, subtree: true, attributeFilter: ["data-stage"] });
  }, String(stage));
  return async () => {
    const kept = await page.waitForFunction(() => (window as unknown as { kept?: string }).kept, undefined, { timeout: TIMEOUT });
    return Buffer.from(String(await kept.jsonValue()).split(",")[1], "base64");
  };
}

/** Wait for the pictures of all coded cameras and write them as NAME1.png, ... */
export async function saveThumbnails(page: Page, count: number, name: string): Promise<void> {
  await page.waitForFunction((all) => document.querySelectorAll("#cameras canvas").length === all, count, { timeout: TIMEOUT });
  const urls = await page.$$eval("#cameras canvas", (found) => found.map((one) => (one as HTMLCanvasElement).toDataURL()));
  urls.forEach((url, at) => writeFileSync(join(RESULTS, `${name}${at + 1}.png`), Buffer.from(url.split(",")[1], "base64")));
}

/** Wait until the last scene is set. */
export async function waitForScene(page: Page): Promise<void> {
  await page.waitForSelector("body[data-done]", { timeout: TIMEOUT });
  await settled(page);
}

/** Wait until the picture stays the same: splats are sorted after they are first drawn. Returns it as PNG. */
export async function settled(page: Page): Promise<Buffer> {
  const deadline = Date.now() + TIMEOUT;
  let before = await page.screenshot({ timeout: TIMEOUT });
  while (Date.now() < deadline) {
    await page.waitForTimeout(1500);
    const after = await page.screenshot({ timeout: TIMEOUT });
    if (after.equals(before)) return after;
    before = after;
  }
  throw new Error("the picture does not stop changing.");
}

/** Wait until the canvas stays the same; returns it as a data URL. The panel may cover it. */
export async function drawn(page: Page): Promise<string> {
  const deadline = Date.now() + TIMEOUT;
  const read = () => page.$eval("#canvas", (canvas) => (canvas as HTMLCanvasElement).toDataURL());
  let before = await read();
  while (Date.now() < deadline) {
    await page.waitForTimeout(1500);
    const after = await read();
    if (after === before) return after;
    before = after;
  }
  throw new Error("the canvas does not stop changing.");
}

/** Wait until the picture is no longer the given one. Throws Error if it stays the same for a minute. */
export async function changed(page: Page, before: Buffer): Promise<void> {
  const deadline = Date.now() + 60_000;
  while (Date.now() < deadline) {
    if (!(await page.screenshot({ timeout: TIMEOUT })).equals(before)) return;
    await page.waitForTimeout(500);
  }
  throw new Error("the picture does not change.");
}
