// The part that a handle holds: hold it, resize it, add or remove parts, and limit the motion to it.
import assert from "node:assert/strict";
import { ALIKE, eventually, hold, shot, state, story, test, until, visibleVertex } from "./page.mjs";

let page;
story((tab) => ({ page } = tab));
/** Click at a pixel while a key is down. */
async function click(at, key) {
  await page.keyboard.down(key);
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.click(...at);
  await page.keyboard.up(key);
}

const level = () => state(page, (s) => s.edit.handles[0].level);
const region = () => state(page, (s) => s.edit.handles[0].region);

test("a held part is resized, combined with others, and moved alone", async (t) => {
  const vertex = await hold(page, ALIKE, 1);

  await t.test("the handle holds a larger part, then the smaller part again", async () => {
    await page.keyboard.press("]");
    await until(page, (s) => s.edit.handles[0].level > 0);
    const larger = await level();
    const steps = page.getByRole("group", { name: "Size of the part" }).getByRole("button");
    const ladder = await until(page, (s) => s.ladders.get(s.edit.handles[0].origin)?.steps);
    await eventually(async () => assert.equal(await steps.count(), ladder.length));
    assert.equal(new Set(ladder.map(({ text }) => text)).size, ladder.length, "two steps have the same words");
    const usual = ladder.findIndex(({ level: each }) => each === 0);
    const words = `${usual + 1} of ${ladder.length}: ${ladder[usual].text}`;
    await eventually(async () => assert.equal(await steps.nth(usual).getAttribute("aria-label"), words));
    const smaller = steps.nth(usual);
    await smaller.hover();
    await until(page, (s) => s.probe !== null);
    assert.equal(await level(), larger, "a step only previews the part until it is pressed");
    await shot(page, "part_preview");
    await smaller.click();
    await until(page, (s) => s.edit.handles[0].level === 0);
    await eventually(async () => {
      assert.equal(await smaller.getAttribute("aria-pressed"), "true");
      assert.equal(await page.locator(".step").textContent(), words);
    });
    assert.equal(await state(page, (s) => s.edit.handles.length), 1);
    await shot(page, "part");
  });

  await t.test("the smallest part cannot be made smaller", async () => {
    const end = page.getByText("There is no smaller part here.");
    for (let i = 0; i < 20 && !(await end.isVisible()); i++, await page.waitForTimeout(300))
      await page.keyboard.press("[");
    await end.waitFor();
    const first = page.getByRole("group", { name: "Size of the part" }).getByRole("button").first();
    await eventually(async () => {
      assert.equal(await first.getAttribute("aria-pressed"), "true");
      assert.match(await page.locator(".step").textContent(), /^1 of /);
    });
    assert.ok(await state(page, (s) => s.toasts.every(({ kind }) => kind === "note")), "a toast is no note");
    await shot(page, "part_smallest");
  });

  await t.test("Shift adds a part, and Ctrl removes it", async () => {
    const vertices = await state(page, (s) => s.mesh.vertices);
    const far = Array.from({ length: 60 }, (_, i) => Math.floor(((i + 0.5) / 60) * vertices));
    /** Click one vertex after the other until the region has the wanted size. The gizmo may cover some vertices. */
    const clickUntil = async (key, wanted) => {
      for (const each of far) {
        const { at } = await visibleVertex(page, [each]).catch(() => ({ at: null }));
        if (!at) continue;
        await click(at, key);
        await page.waitForTimeout(400);
        await until(page, (s) => !s.busy);
        if (wanted(await region())) return region();
      }
      const said = await state(page, (s) => s.toasts.map(({ text }) => text));
      assert.fail(`${key} and a click never changed the region of ${await region()}: ${said}`);
    };
    const grown = await clickUntil("Shift", (size) => size > 0);
    await clickUntil("Control", (size) => size < grown);
    for (let i = 0; i < far.length && (await region()) > 0; i += 1) {
      await page.keyboard.press("Control+z");
      await page.waitForTimeout(300);
    }
    assert.equal(await region(), 0);
  });

  await t.test("with a limit to the part, no other vertex moves", async () => {
    const field = page.getByLabel("Move y", { exact: true });
    await field.fill("0.2");
    await field.press("Enter");
    await until(page, (s) => s.edit.handles[0].translation[1] === 0.2);
    await page.getByLabel("Limit to part").locator("xpath=..").click();
    await until(page, (s) => s.edit.handles[0].mask_part);
    const moved = await page.evaluate(async () => {
      const [posed, rest] = [await window.dfd.computed(), window.dfd.rest()];
      const moved = [];
      for (let i = 0; i < rest.length; i += 3) if (Math.abs(posed[i + 1] - rest[i + 1]) > 1e-5) moved.push(i / 3);
      return moved;
    });
    const part = await state(page, (s) => s.edit.handles[0].mask);
    assert.ok(moved.includes(vertex) && moved.length <= part, `${moved.length} of ${part} moved`);
    await page.getByLabel("Limit to part").scrollIntoViewIfNeeded();
    await shot(page, "part_limited");
  });
});
