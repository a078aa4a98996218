// A large shape: dragged on the GPU with little script a frame, and drawn again after the graphics were lost.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { alive, drag, drawn, hold, launch, open, openTab, PATIENCE, shaderError, shot, until } from "./page.mjs";

const TOLERANCE = 1e-4;
const MOST_MILLISECONDS = 8;
let browser, page, problems;

before(async () => {
  browser = await launch();
  ({ page, problems } = await openTab(browser));
});

after(() => browser?.close());

test("a drag takes little script a frame, and ends as the kernel poses it", { timeout: 2 * PATIENCE }, async () => {
  await open(page, [process.env.DFD_LARGE, process.env.DFD_FIELD]);
  await alive(page);
  await hold(page, null, 1);
  await page.evaluate(() => (window.times = window.dfd.drawingTimes()));
  await drag(page, [0, -50], -60);
  await until(page, () => window.dfd.rests());
  const times = await page.evaluate(() => window.times.sort((a, b) => a - b));
  assert.ok(times.length > 2 && times[times.length >> 1] < MOST_MILLISECONDS, `milliseconds a frame: ${times}`);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await shot(page, "large");
});

test("graphics that were lost come back as they were", { timeout: 2 * PATIENCE }, async () => {
  await page.evaluate(async () => {
    const canvas = document.querySelector("canvas");
    const heard = (name) => new Promise((resolve) => canvas.addEventListener(name, resolve, { once: true }));
    const gone = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
    const lost = heard("webglcontextlost");
    gone.loseContext();
    await lost;
    // Browsers restore no context in the task in which it was lost.
    await new Promise((resolve) => setTimeout(resolve, 100));
    const restored = heard("webglcontextrestored");
    gone.restoreContext();
    await restored;
  });
  await until(page, () => window.dfd.rests());
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await shot(page, "restored");
});

test("nothing went wrong on the way", () => {
  assert.deepEqual(problems, []);
});
