// What the hand does to the model: scale, snap, bends, and that buttons do what they say.
import assert from "node:assert/strict";

import { pull, shot, state, story, test, until } from "./page.mjs";

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
