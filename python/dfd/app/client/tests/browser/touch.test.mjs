// Touch input on a phone: one finger orbits, a tap grabs, and one bar with a menu and a sheet has everything else.
import assert from "node:assert/strict";

import { eventually, shot, state, still, story, test, until, visibleVertex } from "./page.mjs";

let page, fingers;

story((tab) => ({ page } = tab), { viewport: { width: 390, height: 844 }, hasTouch: true, isMobile: true });

/** Move one finger from the pixel `from` by (x, y) pixels. */
async function swipe(from, [x, y]) {
  fingers ??= await page.context().newCDPSession(page);
  const touch = (type, at) =>
    fingers.send("Input.dispatchTouchEvent", { type, touchPoints: at ? [{ x: at[0], y: at[1] }] : [] });
  await touch("touchStart", from);
  for (let i = 1; i <= 6; i++) await touch("touchMove", [from[0] + (x * i) / 6, from[1] + (y * i) / 6]);
  await touch("touchEnd", null);
}

const project = (vertex) => page.evaluate((wanted) => window.dfd.project(wanted), vertex);
const apart = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

test("one finger orbits, and adds no handle", async () => {
  const { vertex, at } = await visibleVertex(page);
  await swipe(at, [80, 20]);
  await eventually(async () => assert.ok(apart(await project(vertex), at) > 10, "the shape did not turn"));
  assert.equal(await state(page, (s) => s.edit.handles.length), 0);
});

test("a tap adds a handle", async () => {
  const { vertex, at } = await visibleVertex(page);
  await page.touchscreen.tap(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  assert.equal(await state(page, (s) => s.edit.handles[0].vertex), vertex);
  await until(page, (s) => s.ladders.has(s.edit.handles[0].origin));
  const { text } = await state(page, (s) => {
    const { origin, level } = s.edit.handles[0];
    return s.ladders.get(origin).steps.find((step) => step.level === level);
  });
  await page.locator(".status .hint", { hasText: text }).waitFor(); // the page says what a tap took
  await shot(page, "touch");
});

test("a finger on the gizmo moves the handle, not the camera", async () => {
  const held = await state(page, (s) => s.edit.handles[0].vertex);
  await still(page);
  const [x, y] = await project(held);
  const camera = () => page.evaluate(() => window.dfd.camera());
  const before = await camera();
  await swipe([x, y - 50], [0, -60]);
  await until(page, (s) => s.edit.handles[0].moved && s.ahead.size === 0);
  assert.ok((await state(page, (s) => s.edit.handles[0].translation[1])) > 0, "the handle did not move up");
  assert.deepEqual(await camera(), before);
});

/** Check that no two buttons of the bar overlap, and that all are inside the window. */
async function assertApart() {
  const boxes = await page.locator(".topbar > *").evaluateAll((all) => all.map((each) => each.getBoundingClientRect()));
  boxes.forEach(({ left, right }, i) => {
    assert.ok(left >= 0 && right <= 390, `a button ends at ${right}`);
    if (i > 0) assert.ok(left >= boxes[i - 1].right, "two buttons overlap");
  });
}

/** Check that all visible targets have at least 44 pixels. */
async function assertLarge(selector) {
  const small = await page.locator(selector).evaluateAll((all) =>
    all
      .map((each) => [each.getAttribute("aria-label") ?? each.textContent, each.getBoundingClientRect()])
      .filter(([, { width, height }]) => height > 0 && (height < 44 || width < 44))
      .map(([name, { width, height }]) => `${name}: ${width} × ${height}`),
  );
  assert.deepEqual(small, []);
}

test("the menu has all actions, and the inspector is a sheet below the shape", async () => {
  await assertApart();
  assert.equal(await page.locator(".toolbar").count(), 0);
  await page.waitForTimeout(500); // a second tap within 300 ms would be a double tap
  await page.getByRole("button", { name: "Menu" }).tap();
  await page.getByRole("menuitem").first().waitFor();
  for (const name of ["Open a mesh", "Brush", "Keys", "Timeline", "Heat", "From the front", "GLB", "Rig"])
    assert.ok((await page.getByRole("menuitem", { name: new RegExp(`^${name}`) }).count()) > 0, name);
  await eventually(async () => {
    const list = await page.locator(".menu-list:popover-open").boundingBox();
    assert.deepEqual([list.x, list.width, Math.round(list.y + list.height)], [0, 390, 844], "the menu is no sheet");
  });
  const titles = await page.locator(".menu-title:visible").allTextContents();
  for (const title of ["File", "What a tap does", "Export", "View"]) assert.ok(titles.includes(title), title);
  await assertLarge('[role="menuitem"], .topbar button');
  await shot(page, "phone_menu");
  await page.getByRole("menuitem", { name: "Keys" }).tap();
  await page.getByRole("dialog", { name: "Keys" }).waitFor();
  await shot(page, "phone_keys");
  await page.getByRole("button", { name: "Close" }).tap();
  await page.getByRole("button", { name: "Motion" }).tap();
  await page.getByRole("menuitem", { name: "Bend" }).tap();
  await until(page, (s) => s.gizmo === "bend");
  await page.getByRole("button", { name: "Inspector" }).tap();
  await eventually(async () => {
    const sheet = await page.locator(".inspector").boundingBox();
    const view = await page.locator("canvas").boundingBox();
    assert.deepEqual([sheet.x, sheet.width], [0, 390]);
    assert.ok(sheet.y >= view.y + view.height && sheet.y + sheet.height <= 844);
    assert.ok(view.height > 300, `the shape has ${view.height} pixels`);
  });
  await page.getByRole("group", { name: "Size of the part" }).waitFor();
  await assertLarge(".inspector button:not(.ladder button), .ladder, .inspector select");
  await shot(page, "phone_sheet");
  await page.getByRole("button", { name: "Menu" }).tap();
  await page.getByRole("menuitem", { name: "Timeline" }).tap();
  await eventually(async () => {
    const line = await page.locator(".timeline").boundingBox();
    const moved = await page.locator(".inspector").boundingBox();
    assert.ok(line.y + line.height <= moved.y + 1, "the timeline covers the sheet");
  });
  await shot(page, "phone_timeline");
});
