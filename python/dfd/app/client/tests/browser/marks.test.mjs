// Marks: points are placed on the shape and dragged to where they must arrive, and the handles follow.
import assert from "node:assert/strict";

import { eventually, pull, shot, state, still, story, test, until, visibleVertex } from "./page.mjs";

let page, vertex;

story((tab) => ({ page } = tab), { held: true });

const panel = () => page.getByRole("region", { name: "Marks" });
const marks = () => state(page, (s) => s.edit.marks);
/** Return the pixel of the target of a mark. */
const goal = (index) =>
  page.evaluate((i) => {
    const { edit, mesh } = window.dfd.store.get();
    return window.dfd.place(edit.marks[i].target.map((part, axis) => part - mesh.center[axis]));
  }, index);

test("a click places a mark where the surface is", async () => {
  await page.getByRole("button", { name: "Marks that must arrive" }).click();
  await until(page, (s) => s.tool === "marks");
  await panel().getByText("Click a point to place a mark.").waitFor();
  assert.equal(await page.evaluate(() => window.dfd.hasGizmo()), false);
  const followers = await page.evaluate(() => window.dfd.following({}));
  const seen = await visibleVertex(page, followers);
  vertex = seen.vertex;
  await page.mouse.click(...seen.at);
  await until(page, (s) => s.edit.marks.length === 1);
  assert.equal((await marks())[0].vertex, vertex);
  await panel().getByText("arrived").waitFor();
});

test("the handles follow a dragged mark, and Esc takes the drag back", async () => {
  const before = await marks();
  await pull(page, await goal(0), [0, 60], async () => {
    await until(page, (s) => s.edit.handles[0].moved);
    await page.keyboard.press("Escape");
    await until(page, (s) => s.marked === null && !s.edit.handles[0].moved);
  });
  assert.deepEqual(await marks(), before);
  await pull(page, await goal(0), [60, -40]);
  await until(page, (s) => s.marked === null && s.edit.handles[0].moved);
  const [{ missing, target }] = await marks();
  const size = await state(page, (s) => s.mesh.diagonal);
  assert.ok(missing < 1e-4 * size, `the mark is ${missing} from its target`);
  assert.ok(Math.hypot(...target.map((x, i) => x - before[0].target[i])) > 0.02 * size);
  await eventually(async () => {
    const [at, wanted] = [await page.evaluate((v) => window.dfd.project(v), vertex), await goal(0)];
    const posed = await page.evaluate((v) => window.dfd.shownVertices().slice(3 * v, 3 * v + 3), vertex);
    assert.ok(
      Math.hypot(...posed.map((x, i) => x - target[i])) < 1e-3 * size,
      `${posed}, not ${target}; ${at} ${wanted}`,
    );
  });
});

test("a second mark at the same part stays, as far as it can", async () => {
  const followers = await page.evaluate(() => window.dfd.following({}));
  const { at } = await visibleVertex(page, followers.toReversed());
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.marks.length === 2);
  await panel().getByText("do not determine all motions").waitFor();
  await pull(page, await goal(0), [-50, -60], async () => {
    await still(page);
    await shot(page, "marks");
  });
  await until(page, (s) => s.marked === null);
});

test("undo takes back a drag and a mark, and the panel removes marks", async () => {
  await page.keyboard.press("Control+z");
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.marks.length === 1);
  await page.keyboard.press("Control+y");
  await until(page, (s) => s.edit.marks.length === 2);
  await panel().getByRole("button", { name: "Remove mark 2" }).click();
  await until(page, (s) => s.edit.marks.length === 1);
  const field = panel().getByLabel("Target of mark 1 y");
  await field.fill("0");
  await field.press("Enter");
  await until(page, (s) => s.edit.marks[0].target[1] === 0);
  await page.keyboard.press("Escape");
  await until(page, (s) => s.tool === "hold");
  assert.equal(await panel().count(), 0);
});
