// One editing session, from opening a mesh to the exported files. It checks positions and pixels.
import assert from "node:assert/strict";

import {
  ALIKE,
  drag,
  drawn,
  exportFile,
  hold,
  openShape,
  ready,
  shaderError,
  shapeSentAgain,
  shot,
  state,
  story,
  test,
  until,
  visibleVertex,
  writeShown,
} from "./page.mjs";

const TOLERANCE = 1e-4;
let page;

story((tab) => ({ page } = tab), { shape: false });

let broken = false;

/** Define a step of the session. After a failed step, the later steps are skipped. */
function step(name, run) {
  test(name, async (context) => {
    if (broken) {
      context.skip("an earlier step failed");
      return;
    }
    broken = true;
    await run(context);
    broken = false;
  });
}

const handles = () => state(page, (s) => s.edit.handles);

step("a shape opens and is visible", async () => {
  await shot(page, "start");
  await openShape(page);
  for (const look of ["clay", "features", "heat", "texture"]) {
    await page.evaluate((name) => window.dfd.store.set({ look: name }), look);
    await until(page, () => window.dfd.rests());
    const seen = await drawn(page);
    assert.ok(seen.covered > 0.03 && seen.shades > 50, `${look} is blank: ${JSON.stringify(seen)}`);
  }
});

step("a click adds a handle", async () => {
  const vertex = await hold(page, ALIKE, 1);
  await until(page, (s) => s.columns.size > 0);
  assert.equal((await handles())[0].vertex, vertex);
  assert.equal(await state(page, (s) => s.selected), (await handles())[0].handle);
});

step("a single counterpart is switched off and on", async () => {
  await until(page, (s) => s.similar !== null && s.similar.places.length > 1);
  const first = page.getByRole("switch", { name: /^Counterpart 1 / });
  await first.locator("xpath=..").click();
  await until(page, (s) => s.edit.handles[0].excluded_counterparts.length === 1 && s.similar.places[1].on === false);
  await first.locator("xpath=..").click();
  await until(page, (s) => s.edit.handles[0].excluded_counterparts.length === 0 && s.similar.places[1].on);
});

/**
 * Return the share of the surface, in per cent, that the status line tells during a drag, when the weights of the present
 * motion have arrived, so that it changes no more.
 */
async function movesAtRest(page) {
  for (let before = null; ; await page.waitForTimeout(800)) {
    await until(page, (s) => s.edit.handles[0].columns.every(({ column }) => s.columns.has(column)));
    const now = /moves (\d+) %/.exec(await page.locator(".status .hint").textContent())?.[1];
    if (now !== undefined && now === before) return Number(now);
    before = now;
  }
}

step("a drag moves the shape as the kernel does, and the wheel moves less or more from the present share", async () => {
  await drag(page, [0, -50], -60, async () => {
    await until(page, (s) => s.edit.handles[0].moved);
    const begun = await movesAtRest(page);
    const level = await state(page, (s) => s.edit.handles[0].level);
    /** Turn the wheel by a notch, and return the share when the new weights are shown. */
    const notch = async (pixels, wanted) => {
      await page.mouse.wheel(0, pixels);
      await until(page, (s, value) => s.edit.handles[0].level === value, wanted);
      return movesAtRest(page);
    };
    const less = await notch(100, level - 1);
    assert.ok(less < begun, `a notch down moves ${less} % instead of ${begun} %`);
    assert.match(await page.locator(".status .hint").textContent(), /^\d of \d: /);
    await shot(page, "dragging");
    const more = await notch(-100, level);
    assert.ok(more > less && Math.abs(more - begun) <= 1, `a notch up moves ${more} % after ${less} % and ${begun} %`);
    assert.equal(await state(page, (s) => s.edit.handles[0].reach_by), "part");
  });
  const [after] = await handles();
  assert.ok(Math.hypot(...after.translation) > 0, "the handle did not move");
  const error = await shaderError(page);
  assert.ok(error <= TOLERANCE, `the shader differs from the kernel by ${error}`);
});

step("with a numeric reach, the wheel changes this reach by small factors", async () => {
  const by = (name) => page.getByRole("group", { name: "Reach by" }).getByRole("button", { name });
  await by("Number").click();
  await until(page, (s) => s.edit.handles[0].reach_by === "number");
  const { reach } = (await handles())[0];
  await drag(page, [0, -50], -10, async () => {
    await page.mouse.wheel(0, 100);
    await page.getByText(/^reach .* · moves/).waitFor();
  });
  await until(page, (s, before) => s.edit.handles[0].reach < before, reach);
  assert.ok((await handles())[0].reach > 0.8 * reach);
});

step("the paper's preset is one setting and one undo step", async () => {
  const before = await handles();
  const settings = (s) => ({ preset: s.edit.preset, reach: s.edit.handles[0].reach });
  const was = await state(page, settings);
  await page.getByLabel("Preset").selectOption("paper");
  await until(page, (s) => s.edit.preset === "paper");
  assert.deepEqual(await state(page, settings), { preset: "paper", reach: 1 });
  assert.deepEqual([(await handles())[0].falloff, (await handles())[0].counterparts], ["linear", "shared_pivot"]);
  assert.ok((await farthest([before[0].vertex])) > 0.001, "the handle no longer moves the shape");
  await page.getByLabel("Preset").scrollIntoViewIfNeeded();
  await shot(page, "paper");
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.preset === "default");
  assert.deepEqual(await state(page, settings), was);
});

step("translation, rotation and scale can be typed", async () => {
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

step("with locality and symmetry, the shader's pose equals the kernel's", async () => {
  await page.getByLabel("Locality").fill("4");
  await until(page, (s) => s.edit.handles[0].locality === 4 && s.ahead.size === 0);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await page.getByRole("group", { name: "Mirror plane" }).getByRole("button", { name: "X", exact: true }).click();
  await until(page, (s) => s.edit.symmetry !== null);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await shot(page, "symmetry");
});

step("a fixed point stays in place", async () => {
  assert.ok(await page.evaluate(() => window.dfd.hasGizmo()));
  await page.keyboard.press("x");
  await until(page, (s) => s.tool === "fix" && !window.dfd.hasGizmo());
  const taken = await state(page, (s) => s.edit.handles[0].vertex);
  const count = await state(page, (s) => s.mesh.vertices);
  const others = Array.from({ length: 80 }, (_, i) => Math.floor(((i + 0.3) / 80) * count)).filter((v) => v !== taken);
  const { vertex, at } = await visibleVertex(page, others);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.fixed.length === 1);
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

/** Return all vertices in descending order of the distance from handles and fixed points. */
function remote() {
  return page.evaluate(() => {
    const { edit, mesh } = window.dfd.store.get();
    const taken = [...edit.handles, ...edit.fixed].map(({ position }) => position.map((x, i) => x - mesh.center[i]));
    const positions = window.dfd.positions();
    const apart = new Map();
    window.dfd.vertices().forEach((vertex, row) => {
      const own = positions.subarray(4 * row, 4 * row + 3);
      apart.set(vertex, Math.min(...taken.map((other) => Math.hypot(...other.map((x, i) => x - own[i])))));
    });
    return [...apart].sort((a, b) => b[1] - a[1]).map(([vertex]) => vertex);
  });
}

/** Paint around a visible vertex far from handles and fixed points, and return the painted vertices. */
async function paint(among = null) {
  await page.keyboard.press("b");
  const { at } = await visibleVertex(
    page,
    (await remote()).filter((vertex) => among?.includes(vertex) ?? true),
  );
  await page.mouse.move(...at);
  await page.mouse.down();
  await page.mouse.move(at[0] + 3, at[1]);
  await page.mouse.up();
  await until(page, (s) => s.painted !== null && s.painted.count > 0);
  const painted = await page.evaluate(() => {
    const { weights } = window.dfd.store.get().painted;
    return [...weights.keys()].filter((vertex) => weights[vertex] > 0);
  });
  assert.equal(painted.length, await state(page, (s) => s.painted.count));
  return painted;
}

/** Return the heights of the vertices in the kernel's pose. */
const heights = () => page.evaluate(async () => (await window.dfd.computed()).filter((_, i) => i % 3 === 1));

/** Return the largest displacement of these vertices by the kernel, divided by the shape's diagonal. */
function farthest(vertices) {
  return page.evaluate(async (wanted) => {
    const kernel = await window.dfd.computed();
    const { mesh } = window.dfd.store.get();
    const rest = window.dfd.rest();
    const moved = (v) => Math.hypot(...[0, 1, 2].map((i) => kernel[3 * v + i] - rest[3 * v + i]));
    return Math.max(...wanted.map(moved)) / mesh.diagonal;
  }, vertices);
}

step("a painted region is fixed, and its strength can be changed", async () => {
  const painted = await paint();
  await shot(page, "painted");
  const before = await state(page, (s) => s.edit.fixed.length);
  await page.getByRole("button", { name: "Fix", exact: true }).click();
  await until(page, (s, count) => s.edit.fixed.length === count + 1, before);
  assert.equal(await state(page, (s) => s.edit.fixed.at(-1).region), painted.length);
  assert.ok((await farthest(painted)) < 1e-5, "the painted region moved");
  assert.ok((await shaderError(page)) <= TOLERANCE);
  await page.getByLabel(`Strength of Region of ${painted.length} vertices`).fill("0.5");
  await until(page, (s) => s.edit.fixed.at(-1).strength === 0.5);
  assert.ok((await shaderError(page)) <= TOLERANCE);
});

step("a painted region is held, and another region limits the handle", async () => {
  // The region is on the hooves, because surface that looks like a fixed point does not follow.
  const hooves = ALIKE;
  const painted = await paint(hooves);
  await page.getByRole("button", { name: "Add handle", exact: true }).click();
  await until(page, (s) => s.edit.handles.length === 2);
  const held = (await handles())[1];
  assert.equal(held.region, painted.length);
  assert.equal(await state(page, (s) => s.selected), held.handle);
  const field = page.getByLabel("Move y", { exact: true });
  await field.fill("0.1");
  await field.press("Enter");
  await until(page, (s) => s.edit.handles[1].moved && s.ahead.size === 0);
  assert.ok((await farthest(painted)) > 0.01, "the held region did not move");
  assert.ok((await shaderError(page)) <= TOLERANCE);
  // With a reach of its part, the handle would end at the part whatever the limit.
  await page.getByRole("group", { name: "Reach by" }).getByRole("button", { name: "Number" }).click();
  await until(page, (s) => s.edit.handles[1].reach_by === "number");
  await page.getByLabel("Reach", { exact: true }).fill("0.7");
  await until(page, (s) => s.edit.handles[1].reach === 0.7);
  const around = await paint(hooves);
  await page.getByRole("button", { name: "Limit", exact: true }).click();
  await until(page, (s, count) => s.edit.handles[1].mask === count, around.length);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  const before = await heights();
  await page.getByLabel("Limit's edge").fill("0.3");
  await until(page, (s) => s.edit.handles[1].mask_feather > 0.2 * s.mesh.diagonal);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  // Vertices that another handle moves too may sink, so only the largest rise is checked.
  const raised = Object.values(await heights()).map((height, i) => height - before[i]);
  assert.ok(Math.max(...raised) > 0.01, "a soft edge does not move more surface than a sharp edge");
});

step("all changes can be undone and redone", async () => {
  while (await state(page, (s) => s.edit.step > 0)) {
    const before = await state(page, (s) => s.edit.after);
    await page.keyboard.press("Control+z");
    await until(page, (s, after) => s.edit.after > after, before);
  }
  assert.equal((await handles()).length, 0);
  while (!(await handles())[0]?.moved) {
    assert.ok(
      await state(page, (s) => s.edit.step < s.edit.steps.length),
      "no step is left to redo, but the handle is at rest",
    );
    const before = await state(page, (s) => s.edit.after);
    await page.keyboard.press("Control+y");
    await until(page, (s, after) => s.edit.after > after, before);
  }
  assert.equal((await handles()).length, 1);
});

step("two key poses are exported as an animation", async () => {
  await page.keyboard.press("t");
  for (const [keys, count] of [
    ["k", 1],
    ["n0k", 2],
  ]) {
    await page.keyboard.type(keys);
    await until(page, (s, wanted) => s.edit.poses.length === wanted, count);
  }
  await shot(page, "timeline");
  await page.keyboard.press("t");
  await exportFile(page, "Animated GLB", "quadruped_poses.glb");
});

/** Check that the edit and the shape are the same as before. */
async function assertUnchanged(before) {
  await ready(page);
  await until(page, (s) => s.edit.handles.length === 1);
  const settings = ({ translation, vertex }) => ({ translation, vertex });
  assert.deepEqual((await handles()).map(settings), before.map(settings));
  await until(page, (s) => s.report !== null);
  assert.ok((await shaderError(page)) <= TOLERANCE);
}

step("a reload keeps the edit", async () => {
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.poses.length === 1);
  await page.keyboard.press("Control+Shift+Z");
  await until(page, (s) => s.edit.poses.length === 2);
  await page.keyboard.press("Control+z");
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.handles[0].moved);
  const before = await handles();
  await page.reload();
  await until(page, (s) => s.edit?.handles.length === 1);
  await assertUnchanged(before);
});

step("a lost connection is opened again, with the same edit", async () => {
  const before = await handles();
  await shapeSentAgain(page, async () => {
    await page.evaluate(() => window.dfd.drop());
    await until(page, (s) => s.link === "lost");
  });
  await assertUnchanged(before);
});

step("all formats are exported, for Python to compare with the shown positions", async () => {
  for (const format of ["GLB", "PLY", "STL", "OBJ"])
    await exportFile(page, format, `quadruped_edited.${format.toLowerCase()}`);
  await writeShown(page, "seen.json");
});
