// The page without a server, out of a folder: a shape is held, dragged, undone, fixed and mirrored. DFD_OUT gets what was
// seen, for others to judge: where the vertices went, bytes until the first drag, and frames a second of one. DFD_HELD
// may name the vertices of which one is held.
import assert from "node:assert/strict";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";

import { alive, drag, drawn, hold, launch, openTab, PATIENCE, shot, state, until, visibleVertex } from "../page.mjs";

const SHAPE = process.env.DFD_SHAPE ?? "animal";
const HELD = JSON.parse(process.env.DFD_HELD ?? "null");
let browser, page, problems;
const seen = {};

before(async () => {
  browser = await launch();
});

after(() => browser?.close());

test("a shape is there after a click", { timeout: PATIENCE }, async () => {
  ({ page, problems } = await openTab(browser));
  await shot(page, "alone-start");
  assert.equal(await page.locator(".drop").count(), 0, "files take a server");
  assert.ok(await page.getByText("pip install").isVisible());
  await page.click(`.samples button:has-text("${SHAPE}")`);
  await alive(page);
});

test("few bytes come before the first drag", { timeout: PATIENCE }, async () => {
  const context = await browser.newContext();
  const fresh = await context.newPage();
  const bodies = [];
  fresh.on("response", (response) => bodies.push(response.body()));
  await fresh.goto(`${process.env.DFD_URL}?shape=${SHAPE}`);
  await fresh.locator(".inspector .empty", { hasText: "Click a point" }).waitFor();
  seen.bytes = (await Promise.all(bodies)).reduce((sum, body) => sum + body.length, 0);
  assert.ok(seen.bytes > 9e5 && seen.bytes < 3e6, `${seen.bytes} bytes`);
  await context.close();
});

test("what would follow lights up under the pointer", { timeout: PATIENCE }, async () => {
  // The page may be laid out anew between a look and a move.
  for (let i = 0; i < 20 && !(await state(page, (s) => s.probe !== null)); i++) {
    const [x, y] = (await visibleVertex(page)).at;
    await page.mouse.move(x - 2, y);
    await page.mouse.move(x, y);
    await page.waitForTimeout(1000);
  }
  assert.ok(await state(page, (s) => s.probe?.layer.values.length === s.mesh.vertices));
  await shot(page, "alone-hover");
});

test("a handle is dragged, and what looks alike follows", { timeout: PATIENCE }, async () => {
  const vertex = await hold(page, HELD, 1);
  await until(page, (s) => s.columns.size > 0);
  await drag(page, [0, -50], 60);
  await page.waitForTimeout(200);
  seen.handle = await state(page, (s) => s.edit.handles[0]);
  assert.equal(seen.handle.vertex, vertex);
  assert.equal(seen.handle.reach_by, "part");
  seen.positions = await page.evaluate(() => {
    const { mesh } = window.dfd.store.get();
    const [rows, vertices] = [window.dfd.positions(), window.dfd.vertices()];
    const found = new Array(3 * mesh.vertices).fill(0);
    vertices.forEach((vertex, row) => [0, 1, 2].forEach((i) => (found[3 * vertex + i] = rows[4 * row + i])));
    return found;
  });
  assert.ok(Math.hypot(...seen.handle.translation) > 0);
  await page.mouse.move(4, 4);
  await page.waitForTimeout(300);
  const { covered, shades } = await drawn(page);
  assert.ok(covered > 0.03 && shades > 50);
  await shot(page, "alone-dragged");
});

test("steps are undone and done again, one for a drag", { timeout: PATIENCE }, async () => {
  await page.keyboard.press("Control+z");
  await until(page, (s) => !s.edit.handles[0].moved);
  await page.keyboard.press("Control+Shift+z");
  await until(page, (s) => s.edit.handles[0].moved);
  await page.keyboard.press("Control+z");
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.handles.length === 0 && !s.edit.can_undo);
  await page.keyboard.press("Control+Shift+z");
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size === 1);
});

test("the reach, a fixed place and a mirror act", { timeout: PATIENCE }, async () => {
  const before = await state(page, (s) => s.edit.handles[0].reach);
  await page.keyboard.press("[");
  await until(page, (s, reach) => s.edit.handles[0].reach < reach && s.ahead.size === 0, before);
  await until(page, (s) => s.edit.handles[0].reach_by === "number" && s.columns.size === 1);
  const kind = (wanted) =>
    until(page, (s, kind) => s.columns.get(s.edit.handles[0].column)?.layer.kind === kind, wanted);
  await kind("distance");
  await page.getByRole("group", { name: "Reach by" }).getByRole("button", { name: "Part" }).click();
  await kind("weight");
  const held = await state(page, (s) => s.edit.handles[0].vertex);
  const others = await page.evaluate(() => window.dfd.vertices().filter((_, row) => row % 97 === 0));
  await page.keyboard.press("x");
  await page.mouse.click(
    ...(
      await visibleVertex(
        page,
        [...others].filter((vertex) => vertex !== held),
      )
    ).at,
  );
  await until(page, (s) => s.edit.fixed.length === 1 && s.columns.size === 2);
  await page.evaluate(() => window.dfd.store.set({ tool: "hold", gizmo: "rotate" }));
  await until(page, (s) => s.axis !== null);
  await page.locator(".chip", { hasText: "X" }).first().click();
  await until(page, (s) => s.edit.symmetry !== null);
  await page.evaluate(() => window.dfd.store.set({ look: "features" }));
  await until(page, (s) => s.featureColors !== null);
  await page.evaluate(() => window.dfd.store.set({ look: "texture", gizmo: "translate" }));
});

test("what takes a server is gray, and says so", { timeout: PATIENCE }, async () => {
  assert.ok((await page.locator("fieldset.unserved").count()) > 2);
  for (const control of await page.locator("fieldset.unserved :is(button, input, select)").all()) {
    assert.ok(await control.isDisabled());
  }
  assert.ok(await page.getByText("pip install").first().isVisible());
  await page.getByRole("button", { name: "Export" }).click();
  assert.equal(await page.locator(".menu-list button:not(:disabled)").count(), 0);
  await page.keyboard.press("Escape");
  assert.deepEqual(problems, []);
});

test("the frames of a drag", { timeout: 2 * PATIENCE }, async () => {
  await drag(page, [0, -50], 40, async () => {
    seen.framesPerSecond = await page.evaluate(() => window.dfd.framesPerSecond(1));
  });
  assert.ok(seen.framesPerSecond > 1);
  writeFileSync(join(process.env.DFD_OUT, "alone.json"), JSON.stringify(seen));
});

test("on a phone", { timeout: 2 * PATIENCE }, async () => {
  const opened = await openTab(browser, { viewport: { width: 390, height: 844 }, hasTouch: true });
  await shot(opened.page, "alone-phone-start");
  await opened.page.click(`.samples button:has-text("${SHAPE}")`);
  await alive(opened.page);
  await hold(opened.page, null, 1);
  await opened.page.waitForTimeout(500);
  await shot(opened.page, "alone-phone");
  assert.deepEqual(opened.problems, []);
});
