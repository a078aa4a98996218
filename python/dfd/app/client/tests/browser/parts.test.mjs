// Parts of the shape: shown under the pointer with Alt, held, added and taken away, and what a handle is limited to.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";
import { launch, openShape, openTab, shot, state, until, visibleVertex } from "./page.mjs";

let browser, page, problems;
before(async () => {
  browser = await launch();
  ({ page, problems } = await openTab(browser));
  await openShape(page);
  await until(page, (s) => s.edit.field.parts);
});
after(() => browser.close());

/** The vertices of the part that is shown, and those that the shader colors. */
const shown = () =>
  page.evaluate(() => {
    const { values } = window.dfd.store.get().probe.layer;
    const colored = new Set();
    const positions = window.dfd.positions();
    window.dfd.vertices().forEach((vertex, row) => positions[4 * row + 3] > 0.5 && colored.add(vertex));
    const part = [...values.keys()].filter((vertex) => values[vertex] > 0);
    return { part, colored: [...colored].sort((a, b) => a - b) };
  });

/** Point at a place with Alt until the part is shown. */
async function point(at) {
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.move(...at);
  await page.keyboard.down("Alt");
  await until(page, (s) => s.probe?.part > 0);
}

/** Alt-click a vertex with what else is held down. */
async function take(at, ...keys) {
  for (const key of ["Alt", ...keys]) await page.keyboard.down(key);
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.click(...at);
  for (const key of ["Alt", ...keys]) await page.keyboard.up(key);
}

test("a part is shown, held and moved alone", async (t) => {
  const { vertex, at } = await visibleVertex(page, JSON.parse(process.env.DFD_ALIKE));
  let part;

  await t.test("Alt shows the part under the pointer", async () => {
    await point(at);
    const seen = await shown();
    part = seen.part;
    assert.ok(part.includes(vertex));
    assert.deepEqual(seen.colored, part, "the shader colors the part and nothing else");
    assert.ok(await page.getByText(`Part of ${part.length.toLocaleString("en")} vertices`).isVisible());
    await shot(page, "part");
    await page.keyboard.up("Alt");
    await until(page, (s) => s.probe?.part === 0);
  });

  await t.test("Alt-click holds it, and again that of the next level", async () => {
    await take(at);
    await until(page, (s, count) => s.edit.handles[0]?.region === count && s.selected !== null, part.length);
    await take(at);
    await until(page, (s, count) => s.edit.handles[0].region !== count, part.length);
    assert.equal(await state(page, (s) => s.edit.handles.length), 1);
    await page.keyboard.press("Control+z");
    await until(page, (s, count) => s.edit.handles[0].region === count, part.length);
  });

  await t.test("Shift adds a part, and Ctrl takes it away", async () => {
    const count = await state(page, (s) => s.mesh.vertices);
    const inside = new Set(part);
    const others = Array.from({ length: 200 }, (_, i) => Math.floor(((i + 0.5) / 200) * count));
    const other = await visibleVertex(
      page,
      others.filter((each) => !inside.has(each)),
    );
    await take(other.at, "Shift");
    await until(page, (s, before) => s.edit.handles[0].region > before, part.length);
    const grown = await state(page, (s) => s.edit.handles[0].region);
    await take(other.at, "Control");
    await until(page, (s, before) => s.edit.handles[0].region < before, grown);
  });

  await t.test("limited to the part, nothing else moves", async () => {
    await page.keyboard.press("Control+z");
    await page.keyboard.press("Control+z");
    await until(page, (s, count) => s.edit.handles[0].region === count, part.length);
    const field = page.getByLabel("Move y", { exact: true });
    await field.fill("0.2");
    await field.press("Enter");
    await until(page, (s) => s.edit.handles[0].translation[1] === 0.2);
    await page.getByLabel("Limit to part").locator("xpath=..").click();
    await until(page, (s) => s.edit.handles[0].mask_part && s.columns.has(s.edit.handles[0].column));
    await page.waitForTimeout(500);
    const moved = await page.evaluate(async () => {
      const [posed, rest] = [await window.dfd.computed(), window.dfd.rest()];
      const moved = [];
      for (let i = 0; i < rest.length; i += 3) if (Math.abs(posed[i + 1] - rest[i + 1]) > 1e-5) moved.push(i / 3);
      return moved;
    });
    const inside = new Set(part);
    assert.deepEqual(
      moved.filter((each) => !inside.has(each)),
      [],
    );
    assert.ok(moved.includes(vertex));
    await page.getByLabel("Limit to part").scrollIntoViewIfNeeded();
    await shot(page, "part_limited");
  });

  await t.test("reach ends with the part, or where it is set", async () => {
    const by = (name) => page.getByRole("group", { name: "Reach by" }).getByRole("button", { name });
    await by("Part").click();
    await until(page, (s) => s.edit.handles[0].reach_by === "part");
    await by("Number").click();
    await until(page, (s) => s.edit.handles[0].reach_by === "number");
    assert.deepEqual(problems, []);
  });
});
