// Touch input: orbit, tap, and the gizmo.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { launch, openShape, openTab, PATIENCE, shot, state, until, visibleVertex } from "./page.mjs";

let browser, page, problems, fingers;

before(async () => {
  browser = await launch();
  const options = { viewport: { width: 800, height: 600 }, hasTouch: true };
  const opened = await openTab(browser, options);
  ({ page, problems } = opened);
  fingers = await opened.context.newCDPSession(page);
  await openShape(page);
});

after(() => browser?.close());

/** Move one finger from the pixel `from` by (x, y) pixels. */
async function swipe(from, [x, y]) {
  const touch = (type, at) =>
    fingers.send("Input.dispatchTouchEvent", { type, touchPoints: at ? [{ x: at[0], y: at[1] }] : [] });
  await touch("touchStart", from);
  for (let i = 1; i <= 6; i++) await touch("touchMove", [from[0] + (x * i) / 6, from[1] + (y * i) / 6]);
  await touch("touchEnd", null);
}

const project = (vertex) => page.evaluate((wanted) => window.dfd.project(wanted), vertex);
const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

test("one finger orbits, and adds no handle", { timeout: PATIENCE }, async () => {
  const { vertex, at } = await visibleVertex(page);
  await swipe(at, [80, 20]);
  await page.waitForTimeout(300);
  assert.ok(apart(await project(vertex), at) > 10, "the shape did not turn");
  assert.equal(await state(page, (s) => s.edit.handles.length), 0);
});

test("a tap adds a handle", { timeout: PATIENCE }, async () => {
  const { vertex, at } = await visibleVertex(page);
  await page.touchscreen.tap(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  assert.equal(await state(page, (s) => s.edit.handles[0].vertex), vertex);
  await shot(page, "touch");
});

test("a finger on the gizmo moves the handle, not the camera", { timeout: PATIENCE }, async () => {
  const held = await state(page, (s) => s.edit.handles[0].vertex);
  const [x, y] = await project(held);
  const camera = () => page.evaluate(() => window.dfd.camera());
  const before = await camera();
  await swipe([x, y - 50], [0, -60]);
  await until(page, (s) => s.edit.handles[0].moved && s.ahead.size === 0);
  assert.ok((await state(page, (s) => s.edit.handles[0].translation[1])) > 0, "the handle did not move up");
  assert.deepEqual(await camera(), before);
});

test("the page reported no errors", () => {
  assert.deepEqual(problems, []);
});
