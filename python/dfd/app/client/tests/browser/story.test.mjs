// What a person does, from a file to a file, against the real server: numbers and pixels, not only that nothing fails.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before, test } from "node:test";

import {
  alive,
  drag,
  drawn,
  launch,
  learn,
  openTab,
  PATIENCE,
  shaderError,
  shot,
  state,
  until,
  visibleVertex,
} from "./page.mjs";

const TOLERANCE = 1e-4;
let browser, page, problems;

before(async () => {
  browser = await launch();
  ({ page, problems } = await openTab(browser));
});

after(() => browser?.close());

let broken = false;

/** A step of one story: after one that failed, the rest would only fail for its sake. */
function step(name, run) {
  test(name, { timeout: 2 * PATIENCE }, async (context) => {
    if (broken) {
      context.skip("an earlier step failed");
      return;
    }
    broken = true;
    await run();
    broken = false;
  });
}

const handles = () => state(page, (s) => s.edit.handles);

step("a shape opens, is seen, and comes alive when it is distilled", async () => {
  if ((await state(page, (s) => s.page)) === "start") {
    await shot(page, "start");
    const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.click(".drop")]);
    await chooser.setFiles(process.env.DFD_MESH);
    await until(page, (s) => s.page === "shape" && s.edit);
  }
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  await learn(page);
  await shot(page, "learning");
  await alive(page);
});

step("resting on a point shows the heat map that it would have", async () => {
  const { at } = await visibleVertex(page);
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.move(...at);
  await until(page, (s) => s.probe !== null);
  const warm = await page.evaluate(() =>
    window.dfd
      .positions()
      .filter((_, i) => i % 4 === 3)
      .reduce((a, b) => Math.max(a, b), 0),
  );
  assert.ok(warm > 0.95, `the point itself should be warmest, got ${warm}`);
});

step("a click takes hold", async () => {
  const { vertex, at } = await visibleVertex(page);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  assert.equal((await handles())[0].vertex, vertex);
  assert.equal(await state(page, (s) => s.selected), (await handles())[0].handle);
});

step("a drag moves the shape as the kernel does, and the wheel changes reach under way", async () => {
  const before = (await handles())[0];
  await drag(page, [0, -50], -60, async () => {
    assert.ok(await page.locator(".ring svg").isVisible());
    await page.mouse.wheel(0, 240);
    await page.waitForTimeout(200);
    await shot(page, "dragging");
  });
  const [after] = await handles();
  assert.ok(Math.hypot(...after.translation) > 0, "the handle did not move");
  if (await state(page, (s) => s.edit.controls.includes("reach"))) {
    await until(page, (s, reach) => s.edit.handles[0].reach < reach, before.reach);
  }
  const error = await shaderError(page);
  assert.ok(error <= TOLERANCE, `the shader differs from the kernel by ${error}`);
});

step("numbers can be typed, for moving, turning and scaling", async () => {
  for (const [label, value] of [
    ["Rotate ° z", "25"],
    ["Scale x", "1.3"],
    ["Move x", "0.1"],
  ]) {
    const field = page.getByLabel(label, { exact: true });
    await field.fill(value);
    await field.press("Enter");
  }
  await until(
    page,
    (s) => s.edit.handles[0].rotation[2] === 25 && s.edit.handles[0].scale[0] === 1.3 && s.ahead.size === 0,
  );
  assert.ok((await shaderError(page)) <= TOLERANCE);
});

step("locality and symmetry show at once what the kernel makes of them", async () => {
  await page.getByLabel("Locality").fill("4");
  await until(page, (s) => s.edit.handles[0].locality === 4 && s.ahead.size === 0);
  await page.waitForTimeout(500);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await page.getByRole("group", { name: "Mirror plane" }).getByRole("button", { name: "X", exact: true }).click();
  await until(page, (s) => s.edit.symmetry !== null);
  await page.waitForTimeout(500);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await shot(page, "symmetry");
});

step("a point is fixed and stays", async () => {
  await page.keyboard.press("x");
  const taken = await state(page, (s) => s.edit.handles[0].vertex);
  const count = await state(page, (s) => s.mesh.vertices);
  const others = Array.from({ length: 80 }, (_, i) => Math.floor(((i + 0.3) / 80) * count)).filter((v) => v !== taken);
  const { vertex, at } = await visibleVertex(page, others);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.fixed.length === 1);
  await page.waitForTimeout(500);
  assert.equal(await state(page, (s) => s.edit.fixed[0].vertex), vertex);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  const moved = await page.evaluate(async (fixed) => {
    const kernel = await window.dfd.computed();
    const { mesh, edit } = window.dfd.store.get();
    return (
      Math.hypot(...edit.fixed[0].position.map((x, i) => x - mesh.center[i] - kernel[3 * fixed + i])) / mesh.diagonal
    );
  }, vertex);
  assert.ok(moved < 1e-5, `the fixed point moved by ${moved}`);
});

step("a painted region is held in place", async () => {
  await page.keyboard.press("b");
  const { at } = await visibleVertex(page);
  await page.mouse.move(...at);
  await page.mouse.down();
  await page.mouse.move(at[0] + 3, at[1]);
  await page.mouse.up();
  await until(page, (s) => s.painted !== null && s.painted.count > 0);
  await shot(page, "painted");
  const before = await state(page, (s) => s.edit.fixed.length);
  await page.getByRole("button", { name: "Fix", exact: true }).click();
  await until(page, (s, count) => s.edit.fixed.length > count || s.toasts.length > 0, before);
});

step("everything can be taken back, and done again", async () => {
  while (await state(page, (s) => s.edit.can_undo)) {
    const before = await state(page, (s) => s.edit.after);
    await page.keyboard.press("Control+z");
    await until(page, (s, after) => s.edit.after > after, before);
  }
  assert.equal((await handles()).length, 0);
  await page.keyboard.press("Control+Shift+Z");
  await until(page, (s) => s.edit.handles.length === 1);
  await page.keyboard.press("Control+Shift+Z");
  await until(page, (s) => s.edit.handles[0].moved);
});

step("key poses are stored and play", async () => {
  await page.keyboard.press("t");
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 1);
  await page.keyboard.press("n");
  await page.keyboard.press("0");
  await until(page, (s) => !s.edit.handles[0].moved);
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 2);
  await page.getByLabel("Moment").fill("0.5");
  const [half, whole] = await state(page, (s) => {
    const own = [...s.moment.values()][0].translation;
    return [Math.hypot(...own), Math.hypot(...s.edit.poses[0].transforms[0].translation)];
  });
  assert.ok(Math.abs(half - whole / 2) < 1e-6 * whole);
  await shot(page, "timeline");
  await page.getByRole("button", { name: "Back to the edit" }).click();
  await page.keyboard.press("t");
});

step("a reload and a lost connection lose nothing", async () => {
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.handles[0].moved);
  const before = JSON.stringify(await handles());
  await page.reload();
  await until(page, (s) => s.edit?.handles.length === 1);
  await alive(page);
  assert.deepEqual(
    JSON.parse(before).map(({ translation, vertex }) => ({ translation, vertex })),
    (await handles()).map(({ translation, vertex }) => ({ translation, vertex })),
  );
  await until(page, (s) => s.columns.size > 0);
  assert.ok((await shaderError(page)) <= TOLERANCE);
});

step("what is exported is what is seen", async () => {
  await page.getByRole("button", { name: "Export" }).click();
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    page.getByRole("menuitem", { name: "OBJ" }).click(),
  ]);
  const file = await download.path();
  const bytes = await readFile(file);
  assert.ok(bytes.length > 1000, "the file is empty");
  if (download.suggestedFilename().endsWith(".obj")) {
    const points = bytes
      .toString()
      .split("\n")
      .filter((line) => line.startsWith("v "))
      .map((line) => line.split(/\s+/).slice(1, 4).map(Number));
    const worst = await page.evaluate(async (exported) => {
      const kernel = await window.dfd.computed();
      const { mesh } = window.dfd.store.get();
      if (exported.length !== mesh.vertices) return Infinity;
      return (
        exported.reduce(
          (most, point, v) => Math.max(most, ...point.map((x, i) => Math.abs(x - mesh.center[i] - kernel[3 * v + i]))),
          0,
        ) / mesh.diagonal
      );
    }, points);
    assert.ok(worst <= TOLERANCE, `the exported file differs by ${worst}`);
  }
});

step("nothing went wrong on the way", () => {
  assert.deepEqual(problems, []);
});
