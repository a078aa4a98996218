// Keys and the wheel: steps of parts before the click, typed motions, views, the list of undo steps, dropped files.
import assert from "node:assert/strict";

import {
  ALIKE,
  choose,
  drag,
  eventually,
  hold,
  shot,
  state,
  still,
  story,
  test,
  until,
  visibleVertex,
} from "./page.mjs";

let page;

story((tab) => ({ page } = tab));

/** Wait until the line that says what to do next matches. */
const hints = (words) => eventually(async () => assert.match(await page.locator(".status .hint").textContent(), words));
const handle = () => state(page, (s) => s.edit.handles[0]);
const heat = () => page.evaluate(() => window.dfd.heat());

test("the wheel and keys step through the parts before a click", async () => {
  await hints(/^Click a part/);
  const { vertex, at } = await visibleVertex(page, ALIKE);
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.move(...at);
  const known = () => until(page, (s) => s.probe?.exact && s.ladders.get(s.probe.vertex));
  const { steps } = await known();
  assert.ok(steps.length > 1);
  const usual = steps.findIndex(({ level }) => level === 0);
  const said = page.locator(".mark.hover .said");
  const at0 = `${usual + 1} of ${steps.length}: ${steps[usual].text}`;
  await eventually(async () => assert.equal(await said.textContent(), at0));
  await hints(new RegExp(`^${at0}.*click to hold it`));
  const warm = async () => (await heat()).filter((each) => each > 0.5).length;
  const before = await warm();
  const camera = await page.evaluate(() => window.dfd.camera());
  const up = usual + 1 < steps.length;
  const to = up ? usual + 1 : usual - 1;
  await page.mouse.wheel(0, up ? -100 : 100);
  await until(page, (s, level) => s.probe?.level === level && s.probe.exact, steps[to].level);
  assert.deepEqual(await page.evaluate(() => window.dfd.camera()), camera, "the wheel must not zoom here");
  await eventually(async () => assert.ok(up === (await warm()) > before, "the shown weights do not follow the step"));
  await eventually(async () => assert.match(await said.textContent(), new RegExp(`^${to + 1} of ${steps.length}: `)));
  await shot(page, "hover_step");
  await page.keyboard.press(up ? "[" : "]");
  await until(page, (s) => s.probe?.level === 0);
  await page.keyboard.press(up ? "]" : "[");
  await until(page, (s, level) => s.probe?.level === level, steps[to].level);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.handles.length === 1);
  assert.deepEqual([(await handle()).vertex, (await handle()).level], [vertex, steps[to].level]);
  await hints(/^Drag an arrow · \[ \] smaller or larger/);
});

test("the weights of a handle at rest are those that a pointer showed before the click", async () => {
  await page.keyboard.press("Delete");
  await until(page, (s) => s.edit.handles.length === 0);
  const { at } = await visibleVertex(page, ALIKE);
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.move(...at);
  await until(page, (s) => s.probe?.exact);
  await until(page, () => window.dfd.rests());
  const shown = await heat();
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  await page.mouse.move(4, 300);
  await until(page, (s) => s.probe === null && window.dfd.rests());
  const held = await eventually(async () => {
    const now = await heat();
    const off = Math.max(...shown.map((each, i) => Math.abs(each - now[i])));
    assert.ok(off < 0.001, `a weight differs by ${off}`);
    return now;
  });
  const between = held.filter((each) => each > 0.1 && each < 0.9).length;
  assert.ok(between > 0, "the weights end as a sharp edge, unlike those of a drag");
});

test("the wheel beside the shape zooms, and so does Ctrl with the wheel", async () => {
  const camera = () => page.evaluate(() => window.dfd.camera());
  for (const [place, key] of [
    [[80, 300], null],
    [(await visibleVertex(page)).at, "Control"],
  ]) {
    const before = await camera();
    await page.mouse.move(place[0] + 1, place[1]);
    await page.mouse.move(...place);
    if (key) await page.keyboard.down(key);
    else await until(page, (s) => s.probe === null);
    await page.mouse.wheel(0, 100);
    await eventually(async () => assert.notDeepEqual(await camera(), before));
    if (key) await page.keyboard.up(key);
  }
});

test("a motion is typed, kept by Enter and cancelled by Esc", async () => {
  await page.mouse.move(4, 300);
  await page.keyboard.type("gx0.25");
  await page.getByText(/^Move x 0\.25 /).waitFor();
  await until(page, (s) => s.ahead.get(s.selected)?.transform.translation[0] === 0.25);
  await page.keyboard.press("Escape");
  await until(page, (s) => s.typed === null && s.ahead.size === 0);
  assert.equal((await handle()).moved, false);
  await page.keyboard.type("gy-.25");
  await page.keyboard.press("Backspace");
  await page.keyboard.press("Enter");
  await until(page, (s) => s.edit.handles[0].moved);
  assert.deepEqual((await handle()).translation, [0, -0.2, 0]);
  await page.keyboard.press("r");
  await page.keyboard.type("g2");
  await page.keyboard.press("Enter");
  await until(page, (s) => s.edit.handles[0].scale[0] === 2);
  assert.deepEqual((await handle()).scale, [2, 2, 2]);
  await page.keyboard.press("w");
  assert.deepEqual(await state(page, (s) => s.edit.steps.slice(-2)), ["Move handle 2", "Scale handle 2"]);
});

test("a number during a drag replaces the motion of the pointer", async () => {
  await page.keyboard.press("0");
  await until(page, (s) => !s.edit.handles[0].moved);
  await drag(page, [0, -50], -40, async () => {
    await page.keyboard.type("0.1");
    await page.keyboard.press("Enter");
  });
  await until(page, (s) => s.edit.handles[0].moved && !s.dragging);
  assert.deepEqual((await handle()).translation, [0, 0.1, 0]);
  const steps = await state(page, (s) => s.edit.steps.length);
  await drag(page, [0, -50], -40, async () => {
    await page.waitForTimeout(200);
    await page.keyboard.press("Escape");
  });
  await until(page, (s, count) => s.edit.step === count && s.edit.handles[0].translation[1] === 0.1, steps);
});

test("the list of steps goes back to any step", async () => {
  const names = await state(page, (s) => s.edit.steps);
  assert.ok(names.includes("Return to rest: handle 2"));
  await page.getByRole("button", { name: "Steps" }).click();
  await shot(page, "steps");
  await page.getByRole("menuitem", { name: "Beginning" }).click();
  await until(page, (s) => s.edit.step === 0 && s.edit.handles.length === 0);
  assert.equal(await state(page, (s) => s.edit.step > 0), false);
  await choose(page, "Steps", "Scale handle 2");
  await until(page, (s) => s.edit.handles[0]?.scale[0] === 2);
});

test("1, 3, 7 look along the axes, 5 makes the view orthographic, and F frames the part", async () => {
  const direction = () => page.evaluate(() => window.dfd.direction());
  for (const [key, axis] of [
    ["1", 2],
    ["3", 0],
    ["7", 1],
  ]) {
    await page.keyboard.press(key);
    const found = await direction();
    assert.ok(found[axis] > 0.999, `key ${key} looks from ${found}`);
  }
  await page.keyboard.press("Shift+Digit1");
  assert.ok((await direction())[2] < -0.999);
  // From the front, the x axis of the compass is 32 pixels to the right of its middle.
  await page.keyboard.press("1");
  await still(page); // the compass turns with the next picture
  const view = await page.locator("canvas").boundingBox();
  await page.mouse.click(view.x + view.width - 64 + 32, view.y + view.height - 32 - 64);
  await eventually(async () => assert.ok((await direction())[0] > 0.999, "the compass does not turn the view"));
  assert.equal(await state(page, (s) => s.edit.handles.length), 1);
  /** Return the width of a unit at two depths, in pixels. */
  const widths = async () => {
    await until(page, () => window.dfd.rests());
    return page.evaluate(() => {
      const { diagonal } = window.dfd.store.get().mesh;
      return [-0.4, 0.4].map((depth) => {
        const [a, b] = [0, 0.1].map((x) => window.dfd.place([x * diagonal, 0, depth * diagonal]));
        return Math.abs(a[0] - b[0]);
      });
    });
  };
  await page.keyboard.press("Shift+F");
  await page.keyboard.press("1");
  const [far, near] = await widths();
  assert.ok(near > 1.2 * far);
  await page.keyboard.press("5");
  const [back, front] = await widths();
  assert.ok(Math.abs(front - back) < 0.005 * front, `${front} and ${back} pixels`);
  assert.ok(back > far && back < near, `the view changes its size: ${[far, back, near]}`);
  await shot(page, "orthographic");
  await page.keyboard.press("f");
  assert.ok((await widths())[0] > 1.2 * back, "the held part is not framed");
  await page.keyboard.press("5");
  await page.keyboard.press("Shift+F");
});

test("brush actions are beside the selection, at any size of the window", async () => {
  for (const size of [
    { width: 1440, height: 900 },
    { width: 1024, height: 600 },
    { width: 390, height: 844 },
  ]) {
    await page.setViewportSize(size);
    await page.evaluate(() => window.dfd.store.set({ inspector: false }));
    await page.keyboard.press("b");
    await page.waitForFunction((width) => window.innerWidth === width, size.width);
    const { at } = await visibleVertex(page);
    await page.mouse.move(...at);
    await page.mouse.down();
    await page.mouse.up();
    await until(page, (s) => s.painted !== null);
    await eventually(async () => {
      const box = await page.getByRole("button", { name: "Add handle", exact: true }).boundingBox();
      const apart = Math.hypot(box.x - at[0], box.y - at[1]);
      assert.ok(box.x >= 0 && box.y > 0 && box.x + box.width <= size.width && box.y + box.height < size.height);
      assert.ok(apart < 320, `the actions are at ${box.x}, ${box.y}, far from ${at}`);
    });
    await shot(page, `beside-${size.width}`);
    await page.keyboard.press("Escape");
  }
  await page.setViewportSize({ width: 1440, height: 900 });
});

test("a file that is dragged over the page highlights the page", async () => {
  const fire = (type) =>
    page.evaluate((name) => {
      const dataTransfer = new window.DataTransfer();
      dataTransfer.items.add(new window.File(["x"], "x.obj"));
      document.body.dispatchEvent(new window.DragEvent(name, { bubbles: true, dataTransfer }));
    }, type);
  const shown = page.getByText("Drop the files to open them");
  await fire("dragover");
  await shown.waitFor();
  await fire("dragleave");
  await shown.waitFor({ state: "detached" });
});

test("the panel says what stays behind, and that no part was found", async () => {
  await page.evaluate(() => window.dfd.store.set({ inspector: true, tool: "hold" }));
  await hold(page, null, await state(page, (s) => s.edit.handles.length + 1));
  await until(page, (s) => {
    const own = s.edit.handles.find(({ handle }) => handle === s.selected);
    return s.ladders.has(own.origin);
  });
  const tell = (found, leaves) =>
    page.evaluate(
      (told) => {
        const { store } = window.dfd;
        const { edit, selected, ladders } = store.get();
        const { origin } = edit.handles.find(({ handle }) => handle === selected);
        const ladder = ladders.get(origin);
        const steps = ladder.steps.map((each) => ({ ...each, ...told }));
        store.set({ ladders: new Map([...ladders, [origin, { ...ladder, steps }]]) });
      },
      { found, leaves },
    );
  await tell(true, true);
  await page.getByText("Another piece touches this part").waitFor();
  await tell(false, false);
  await page.getByText("No part was found here").waitFor();
});
