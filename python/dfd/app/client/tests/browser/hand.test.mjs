// What the hand does to the model: scale, snap, bends, and that buttons do what they say.
import assert from "node:assert/strict";

import { eventually, pull, shot, state, story, test, until } from "./page.mjs";

let page;

story((tab) => ({ page } = tab), { held: true });

const handle = () => state(page, (s) => s.edit.handles[0]);
const grip = () => page.evaluate(() => window.dfd.grip());
const press = (name) => page.getByRole("button", { name, exact: true }).click();
/** Wait until a button shows whether it is on. */
const pressed = (name, on) => page.getByRole("button", { name, exact: true, pressed: on }).waitFor();
/** The height of the view in pixels, of which the arms of the gizmo are a fraction. */
const height = async () => (await page.locator("canvas").boundingBox()).height;

async function rest() {
  await page.keyboard.press("0");
  await until(page, (s) => !s.edit.handles[0].moved && s.ahead.size === 0);
}

test("the middle of the scale gizmo scales by the pixels of the drag", async () => {
  await press("Scale");
  await until(page, (s) => s.gizmo === "scale" && s.axis !== null && window.dfd.rests());
  await page.mouse.move(4, 300);
  for (const [off, by] of [
    [0, [67, -45]],
    [0, [40, -30]],
    [6, [40, -30]],
    [0, [-300, 200]],
  ]) {
    const [x, y] = await grip();
    await pull(page, [x + off, y], by);
    await until(page, (s) => s.edit.handles[0].moved);
    const { scale } = await handle();
    const wanted = Math.max(1 + (by[0] - by[1]) / Math.SQRT2 / (0.102 * (await height())), 0.01);
    scale.forEach((part) => assert.ok(Math.abs(part / wanted - 1) < 0.1, `${scale} instead of ${wanted}`));
    await rest();
  }
});

test("a cube of the scale gizmo that passes the middle does not flip the part", async () => {
  const [x, y] = await grip();
  const arm = 0.1 * (await height());
  await pull(page, [x, y - arm], [0, 1.6 * arm]);
  await until(page, (s) => s.edit.handles[0].moved);
  const { scale } = await handle();
  assert.ok(scale[1] >= 0.01 && scale[1] < 0.1, `scaled by ${scale}`);
  assert.deepEqual([scale[0], scale[2]], [1, 1]);
  await rest();
});

test("the ring around the scale gizmo scales evenly", async () => {
  const [x, y] = await grip();
  const ring = 0.1445 * (await height());
  const camera = await page.evaluate(() => window.dfd.camera());
  await pull(page, [x - ring, y], [-40, 0], () => shot(page, "ring"));
  await until(page, (s) => s.edit.handles[0].moved);
  const { scale } = await handle();
  const wanted = 1 + 40 / (0.102 * (await height()));
  scale.forEach((part) => assert.ok(Math.abs(part / wanted - 1) < 0.03, `${scale} instead of ${wanted}`));
  assert.deepEqual(await page.evaluate(() => window.dfd.camera()), camera);
  await rest();
});

test("with snap, motions have whole steps from where the drag began", async () => {
  await press("Move");
  const step = 10 ** Math.floor(Math.log10((await state(page, (s) => s.mesh.diagonal)) / 50));
  await page.getByLabel("Move y", { exact: true }).fill("0.0137");
  await page.getByLabel("Move y", { exact: true }).press("Enter");
  await until(page, (s) => s.edit.handles[0].translation[1] === 0.0137 && s.ahead.size === 0);
  await press("Snap");
  await until(page, (s) => s.snap);
  await pressed("Snap", true);
  const [x, y] = await grip();
  await pull(page, [x, y - 50], [0, -61]);
  const moved = (await handle()).translation[1] - 0.0137;
  const steps = moved / step;
  assert.ok(moved > 0 && Math.abs(steps - Math.round(steps)) < 1e-6, `moved by ${moved}, ${steps} steps of ${step}`);
  await rest();
  await press("Rotate");
  await until(page, (s) => s.gizmo === "rotate" && s.axis !== null && window.dfd.rests());
  const at = await grip();
  const outer = 0.101 * (await height());
  await pull(page, [at[0] + outer * Math.SQRT1_2, at[1] + outer * Math.SQRT1_2], [30, -70]);
  await until(page, (s) => s.edit.handles[0].moved);
  const turned = Math.hypot(...(await handle()).rotation);
  assert.ok(turned > 1 && Math.abs(turned / 15 - Math.round(turned / 15)) < 1e-3, `rotated by ${turned}°`);
  await rest();
  await press("Scale");
  await until(page, (s) => s.gizmo === "scale" && window.dfd.rests());
  await pull(page, await grip(), [31, -12]);
  const { scale } = await handle();
  assert.ok(scale[0] > 1.2 && Math.abs(10 * scale[0] - Math.round(10 * scale[0])) < 1e-6, `scaled by ${scale}`);
  await press("Snap");
  await rest();
});

test("the tip of a bent part follows the pointer, pixel by pixel", async () => {
  await press("Bend");
  await until(page, (s) => s.axis?.bends && window.dfd.rests());
  /** Return the pixel of the vertex nearest to the tip at rest, as the kernel bends it. */
  const tip = () =>
    page.evaluate(async () => {
      const { axis, mesh } = window.dfd.store.get();
      const wanted = axis.bends.nodes.at(-1).map((x, i) => x - mesh.center[i]);
      const rest = window.dfd.rest();
      let [best, least] = [0, Infinity];
      for (let v = 0; v < rest.length / 3; v++) {
        const apart = Math.hypot(...wanted.map((x, i) => x - rest[3 * v + i]));
        if (apart < least) [best, least] = [v, apart];
      }
      const posed = await window.dfd.computed();
      return window.dfd.place([...posed.subarray(3 * best, 3 * best + 3)]);
    });
  for (let round = 0; round < 2; round++) {
    const [at, before] = [await grip(), await tip()];
    await pull(page, at, [32, -8]);
    await until(page, (s) => s.edit.handles[0].moved && s.posed && window.dfd.rests());
    await eventually(async () => {
      const now = await grip();
      assert.ok(Math.hypot(now[0] - at[0] - 32, now[1] - at[1] + 8) < 3, `the grip went from ${at} to ${now}`);
    });
    const moved = await tip();
    const [dx, dy] = [moved[0] - before[0], moved[1] - before[1]];
    assert.ok(Math.hypot(dx - 32, dy + 8) < 10, `the tip moved by ${dx}, ${dy} pixels`);
  }
  await shot(page, "bend_grip");
  assert.ok(Math.hypot(...(await handle()).bend) < 120);
  await rest();
  await press("Move");
});

test("each button of the toolbar runs the action of its name", async () => {
  await press("Suggest handles");
  await until(page, (s) => s.suggestions.length > 0);
  assert.equal(await state(page, (s) => s.typed), null);
  await press("Suggest handles");
  await until(page, (s) => s.suggestions.length === 0);
  for (const [name, key] of [
    ["Local or world axes", "local"],
    ["X-ray", "xray"],
    ["Show only the handle's part", "isolated"],
    ["Snap", "snap"],
  ]) {
    await press(name);
    await until(page, `(s) => s.${key} === true`);
    await pressed(name, true);
    await press(name);
    await until(page, `(s) => s.${key} === false`);
    await pressed(name, false);
  }
  await press("Move the pivot");
  await until(page, (s) => s.tool === "pivot");
  await press("Add handles");
  await until(page, (s) => s.tool === "hold");
});
