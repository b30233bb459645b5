/** The self-contained page of decoded Gaussians, from disk and from a server, in headless Chromium. */

import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { changed, drawn, launch, open, RESULTS, saveThumbnails, settled, waitForScene } from "./chromium";
import { serve } from "./static-server";

const FROM_DISK = `file://${process.cwd()}/${RESULTS}/scene.html`; // of scene-compact-6.fcs, 2 views of 192x128
let browser: Browser;

before(async () => {
  browser = await launch();
});
after(() => browser?.close());

/** Open the page with its panel hidden, at the first coded camera. */
async function openScene(url: string): Promise<{ page: Page; problems: string[] }> {
  const opened = await open(browser, url, 192, 128);
  await waitForScene(opened.page);
  await opened.page.keyboard.press("h");
  return opened;
}

async function press(page: Page, key: string): Promise<Buffer> {
  await page.keyboard.press(key);
  return settled(page);
}

test("the page opens from disk at the coded cameras", async () => {
  const { page, problems } = await openScene(FROM_DISK);
  writeFileSync(join(RESULTS, "page1.png"), await settled(page));
  writeFileSync(join(RESULTS, "page2.png"), await press(page, "2"));
  assert.match((await page.textContent("#licences")) ?? "", /three 0\.[^]*FeCoSplat, Apache-2\.0/);
  assert.deepEqual(problems, []);
  await page.close();
});

test("a server can send the page", async () => {
  const server = await serve({ page: RESULTS });
  const { page, problems } = await openScene(`${server.url}/page/scene.html`);
  assert.equal(await page.isVisible("#problem"), false);
  assert.deepEqual(problems, []);
  await page.close();
  server.close();
});

test("dragging orbits, and the key of a camera returns to it", async () => {
  const { page } = await openScene(FROM_DISK);
  const atCamera = await settled(page);
  await page.mouse.move(96, 64);
  await page.mouse.down();
  await page.mouse.move(126, 70, { steps: 4 });
  await page.mouse.up();
  assert.ok(!(await settled(page)).equals(atCamera));
  assert.ok((await press(page, "1")).equals(atCamera));
  await page.close();
});

/** Move fingers over the page in steps, with the browser's own touch events. paths: [from, to] of each finger. */
async function touch(page: Page, paths: [number, number][][]): Promise<void> {
  const session = await page.context().newCDPSession(page);
  const send = (type: "touchStart" | "touchMove" | "touchEnd", touchPoints: { x: number; y: number; id: number }[]) =>
    session.send("Input.dispatchTouchEvent", { type, touchPoints });
  const points = (share: number) =>
    paths.map(([from, to], id) => ({ id, x: from[0] + share * (to[0] - from[0]), y: from[1] + share * (to[1] - from[1]) }));
  await send("touchStart", points(0));
  for (const share of [0.25, 0.5, 0.75, 1]) await send("touchMove", points(share));
  await send("touchEnd", []);
}

test("one finger orbits, two fingers zoom", async () => {
  const { page } = await openScene(FROM_DISK);
  const atCamera = await settled(page);
  await touch(page, [[[96, 64], [126, 70]]]);
  const orbited = await settled(page);
  assert.ok(!orbited.equals(atCamera));
  assert.ok((await press(page, "1")).equals(atCamera));
  await touch(page, [[[86, 64], [66, 64]], [[106, 64], [126, 64]]]);
  assert.ok(!(await settled(page)).equals(atCamera));
  await page.close();
});

test("the buttons of the coded cameras show what they see, and the keyboard reaches them", async () => {
  const { page, problems } = await open(browser, FROM_DISK, 240, 160);
  await saveThumbnails(page, 2, "page-thumbnail");
  const start = await drawn(page);
  await page.click("#cameras button:nth-child(2)");
  assert.notEqual(await drawn(page), start);
  await page.keyboard.press("Shift+Tab");
  assert.equal(await page.evaluate(() => document.activeElement?.textContent), "View 1");
  await page.keyboard.press("Enter");
  assert.equal(await drawn(page), start);
  assert.deepEqual(problems, []);
  await page.close();
});

test("the play button moves through the views, and a tap stops it", async () => {
  const { page, problems } = await open(browser, FROM_DISK, 420, 300);
  await waitForScene(page);
  const start = await drawn(page);
  await page.click("#play");
  assert.equal(await page.getAttribute("#play", "aria-pressed"), "true");
  await page.waitForFunction((before) => (document.getElementById("canvas") as HTMLCanvasElement).toDataURL() !== before, start);
  await page.mouse.click(210, 250);
  assert.equal(await page.getAttribute("#play", "aria-pressed"), "false");
  await page.click("#cameras button:nth-child(1)");
  assert.equal(await drawn(page), start);
  assert.deepEqual(problems, []);
  await page.close();
});

/** Drag from right to left over most of the page. */
async function dragFar(page: Page): Promise<Buffer> {
  await page.mouse.move(180, 64);
  await page.mouse.down();
  await page.mouse.move(10, 64, { steps: 6 });
  await page.mouse.up();
  return settled(page);
}

test("the camera stays where the views see, with a hint, unless it is let go", async () => {
  const { page } = await openScene(FROM_DISK);
  await page.evaluate(() => {
    const hints: string[] = ((window as unknown as { hints: string[] }).hints = []);
    const hint = document.getElementById("hint")!;
    new MutationObserver(() => hints.push(hint.textContent!)).observe(hint, { childList: true });
  });
  const held = await dragFar(page);
  const hints = await page.evaluate(() => (window as unknown as { hints: string[] }).hints);
  assert.ok(hints.some((hint) => hint.startsWith("The views show no more from here.")));
  await page.keyboard.press("n");
  assert.equal(await page.getAttribute("#stay", "aria-pressed"), "false");
  await press(page, "1");
  const free = await dragFar(page);
  writeFileSync(join(RESULTS, "held.png"), held);
  writeFileSync(join(RESULTS, "free.png"), free);
  assert.ok(!free.equals(held));
  await page.close();
});

for (const ending of ["ply", "spz"]) {
  test(`a page of a .${ending} file alone shows its Gaussians`, async () => {
    const { page, problems } = await open(browser, FROM_DISK.replace("scene.html", `${ending}.html`), 450, 300);
    await waitForScene(page);
    assert.match(await page.innerText("#status"), /^scene: [0-9,]+ Gaussians$/);
    assert.equal(await page.isVisible("#cameras"), false);
    writeFileSync(join(RESULTS, `${ending}.png`), Buffer.from((await drawn(page)).split(",")[1], "base64"));
    assert.deepEqual(problems, []);
    await page.close();
  });
}

test("flying moves with the keys", async () => {
  const { page } = await openScene(FROM_DISK);
  const atCamera = await press(page, "o");
  assert.equal(await page.getAttribute("#mode", "aria-pressed"), "true");
  await page.keyboard.down("w");
  await changed(page, atCamera); // a frame can take seconds
  await page.keyboard.up("w");
  await page.close();
});

test("a page without valid Gaussians says so", async () => {
  const server = await serve({ page: join(process.cwd(), "..", "fecocodec", "web") });
  const { page } = await open(browser, `${server.url}/page/scene.html`, 400, 300);
  await page.waitForSelector("#problem:not([hidden])");
  assert.match(await page.innerText("#problem"), /This scene could not be shown/);
  await page.close();
  server.close();
});
