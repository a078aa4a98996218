// Bends, the timeline and its exports, the pivot, the X-ray and isolate modes, and the box tool.
import assert from "node:assert/strict";

import {
  drawn,
  eventually,
  exportFile,
  pull,
  shaderError,
  shot,
  state,
  still,
  story,
  test,
  until,
  writeShown,
} from "./page.mjs";

let page;

story((tab) => ({ page } = tab), { held: true, viewport: { width: 800, height: 600 } });

/** Wait until the canvas shows the state that the server confirmed. */
const settled = () => until(page, (s) => s.ahead.size === 0 && window.dfd.rests());
const handle = () => state(page, (s) => s.edit.handles[0]);

test("rarely used settings are hidden, and the page remembers when they are shown", async () => {
  const strength = page.getByLabel("Strength", { exact: true });
  await page.evaluate(() => window.dfd.store.set({ more: false }));
  await strength.waitFor({ state: "detached" });
  await shot(page, "folded");
  await page.getByRole("button", { name: "More" }).first().click();
  await strength.waitFor();
  assert.equal(await page.evaluate(() => window.localStorage.getItem("dfd-more")), "true");
  await page.evaluate(() => window.dfd.store.set({ more: false }));
});

test("a drag of the tip bends the held part as the kernel does", async () => {
  await page.keyboard.press("d");
  await until(page, (s) => s.axis?.bends && window.dfd.rests());
  const at = await page.evaluate(() => {
    const { axis, mesh } = window.dfd.store.get();
    return window.dfd.place(axis.bends.nodes.at(-1).map((x, i) => x - mesh.center[i]));
  });
  await pull(page, at, [45, -15]);
  await until(page, (s) => s.edit.handles[0].bend.some((part) => part !== 0) && s.ahead.size === 0 && s.posed);
  const { bend, translation } = await handle();
  assert.ok(Math.hypot(...bend) > 5, `bent by ${bend}`);
  assert.deepEqual(translation, [0, 0, 0]);
  assert.ok((await shaderError(page)) <= 1e-4);
  await page.mouse.move(400, 590);
  const [x, y] = await page.evaluate(async () => {
    const { vertex } = window.dfd.store.get().edit.handles[0];
    return window.dfd.place([...(await window.dfd.computed()).subarray(3 * vertex, 3 * vertex + 3)]);
  });
  await eventually(async () => {
    const mark = await page.locator(".mark.handle.selected").boundingBox();
    assert.ok(Math.hypot(mark.x - x, mark.y - y) < 2, `the mark is at ${mark.x}, ${mark.y}, its surface at ${x}, ${y}`);
  });
  await shot(page, "bent");
  await page.getByLabel("Twist °").fill("20");
  await page.getByLabel("Twist °").press("Enter");
  await until(page, (s) => s.edit.handles[0].twist === 20);
});

test("a moment of the timeline is exported as the page shows it, half bent", async () => {
  await page.keyboard.press("t");
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 1);
  await page.keyboard.press("0");
  await until(page, (s) => !s.edit.handles[0].moved);
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 2);
  await page.getByLabel("Moment").fill("0.5");
  const bend = await state(page, (s) => [...s.moment.values()][0].bend);
  // The edit is at rest, so the server computes a pose only for this moment.
  await until(page, (s) => s.posed !== null);
  await shot(page, "moment");
  await writeShown(page, "moment.json");
  await exportFile(page, "GLB", "quadruped_edited.glb", "quadruped_moment.glb");
  await exportFile(page, "Rig", "quadruped_rig.glb");
  await exportFile(page, "Weights", "quadruped_weights.npz");
  await page.evaluate(() => window.dfd.store.set({ toasts: [] }));
  assert.ok(Math.hypot(...bend) > 2);
  assert.equal((await handle()).moved, false, "the timeline must not change the edit");
  await page.locator("body").click({ position: { x: 400, y: 20 } });
  await page.getByRole("button", { name: "Timeline" }).focus();
  await page.keyboard.press("Space");
  await until(page, (s) => s.playing);
  await page.keyboard.press("Escape");
  await until(page, (s) => !s.playing && s.moment === null);
  await page.keyboard.press("t");
});

test("a handle turns about the automatic pivot, or about the chosen pivot", async () => {
  await page.keyboard.press("e");
  await page.evaluate(() => window.dfd.store.set({ more: true }));
  await until(page, (s) => s.axis?.handle === s.selected);
  await page.getByLabel("Rotate ° z").fill("20");
  await page.getByLabel("Rotate ° z").press("Enter");
  await until(page, (s) => s.edit.handles[0].rotation[2] === 20);
  const [pivot, auto] = await state(page, (s) => [s.edit.handles[0].pivot, s.axis.auto]);
  assert.deepEqual(pivot, auto);
  await page.getByLabel("Rotate about").selectOption("point");
  await until(page, (s) => s.edit.handles[0].pivot_at === "point");
  assert.deepEqual((await handle()).pivot, (await handle()).position);
  await page.keyboard.press("0");
  await until(page, (s) => !s.edit.handles[0].moved);
});

test("X-ray makes the shape transparent, and isolate shows only the held part", async () => {
  await page.mouse.move(400, 590);
  await settled();
  const whole = await drawn(page);
  await page.keyboard.press("v");
  await until(page, (s) => s.xray);
  await settled();
  await shot(page, "xray");
  const through = await drawn(page);
  assert.ok(through.covered > 0.95 * whole.covered && through.shades !== whole.shades);
  await page.keyboard.press("v");
  await page.keyboard.press("/");
  await until(page, (s) => s.isolated);
  await settled();
  const alone = await drawn(page);
  assert.ok(alone.covered > 0 && alone.covered < 0.6 * whole.covered, `${alone.covered} of ${whole.covered}`);
  await shot(page, "isolated");
  await page.keyboard.press("Escape");
  await until(page, (s) => !s.isolated && s.selected !== null);
});

test("a box selects the visible vertices in it, and with X-ray also the hidden vertices", async () => {
  await still(page);
  const canvas = await page.locator("canvas").first().boundingBox();
  const draw = async () => {
    await page.mouse.move(canvas.x + 0.3 * canvas.width, canvas.y + 0.2 * canvas.height);
    await page.mouse.down();
    await page.mouse.move(canvas.x + 0.5 * canvas.width, canvas.y + 0.5 * canvas.height);
    await page.mouse.move(canvas.x + 0.6 * canvas.width, canvas.y + 0.6 * canvas.height);
    await page.waitForTimeout(50);
    await shot(page, "box");
    await page.mouse.up();
    await until(page, (s) => s.painted !== null);
    const { count } = await state(page, (s) => ({ count: s.painted.count }));
    return count;
  };
  await page.keyboard.press("m");
  const seen = await draw();
  await page.mouse.move(4, 300);
  await settled();
  await shot(page, "boxed");
  await page.keyboard.press("Escape");
  await until(page, (s) => s.painted === null && s.tool === "hold");
  await page.keyboard.press("v");
  await page.keyboard.press("m");
  const through = await draw();
  assert.ok(seen > 20 && through > 1.3 * seen, `${seen} of ${through}`);
  await page.getByRole("button", { name: "Fix", exact: true }).click();
  await until(page, (s, count) => s.edit.fixed[0]?.region === count, through);
  await page.keyboard.press("v");
});
