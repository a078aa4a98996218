// The rows beside the hand: names, symmetry, fixing, colors and pictures, the timeline, and proposals.
import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";

import { choose, drag, eventually, pull, shot, state, story, test, until, visibleVertex } from "./page.mjs";

let page;

story((tab) => ({ page } = tab), { held: true });

const heat = () => page.evaluate(() => Math.max(...window.dfd.heat()));
/** Wait until the largest heat is in a range. */
const warms = (least, most, message) =>
  eventually(async () => {
    const found = await heat();
    assert.ok(found >= least && found <= most, `${message}: ${found}`);
  });

test("the tab is called after the shape, and the label under the pointer is gone after a click", async () => {
  await eventually(async () => assert.match(await page.title(), /^quadruped\.glb – dfd$/));
  await eventually(async () => assert.equal(await page.locator(".mark.hover").count(), 0));
});

test("renaming selects the old name", async () => {
  await page.locator(".row-name").dblclick();
  await page.locator(".rename:focus").waitFor();
  await page.keyboard.type("Legs");
  await page.keyboard.press("Enter");
  await until(page, (s) => s.edit.handles[0].name === "Legs");
});

test("the place of a handle is copied for Python and the command line", async () => {
  await page.evaluate(() =>
    Object.defineProperty(window.navigator.clipboard, "writeText", {
      value: (text) => Promise.resolve((window.copied = text)),
    }),
  );
  await page.getByRole("button", { name: "Copy the place" }).click();
  await page.getByText("is copied, for --handle").waitFor();
  const copied = (await page.evaluate(() => window.copied)).split(",").map(Number);
  const { position } = await state(page, (s) => s.edit.handles[0]);
  const size = await state(page, (s) => s.mesh.diagonal);
  copied.forEach((part, i) => assert.ok(Math.abs(part - position[i]) < 1e-3 * size, `${copied}, not ${position}`));
});

test("the planes of symmetry have a fixed order, and a choice shows at once", async () => {
  const group = page.getByRole("group", { name: "Mirror plane" });
  await eventually(async () => {
    const names = await group.getByRole("button").allTextContents();
    assert.deepEqual(names.slice(0, 4), ["None", "X", "Y", "Z"]);
  });
  const other = (await group.getByRole("button", { pressed: true }).textContent()) === "Y" ? "Z" : "Y";
  const shown = await page.evaluate((name) => {
    const found = [...document.querySelectorAll('[aria-label="Mirror plane"] button')];
    const button = found.find((each) => each.textContent === name);
    button.click();
    return new Promise((resolve) =>
      requestAnimationFrame(() => setTimeout(() => resolve(button.getAttribute("aria-pressed")))),
    );
  }, other);
  assert.equal(shown, "true");
  const axis = "XYZ".indexOf(other);
  await until(page, (s, i) => Math.abs(s.edit.symmetry?.normal[i] ?? 0) > 0.99, axis);
  await group.getByRole("button", { name: "None" }).click();
  await until(page, (s) => s.edit.symmetry === null);
});

test("weights are colored while a part is chosen, and then only on request", async () => {
  await page.mouse.move(4, 300);
  await warms(0.9, 1, "a handle at rest does not show what follows");
  await page.locator(".legend").waitFor();
  await drag(page, [0, -50], -30);
  await warms(0, 0, "the colors hide the texture after the motion");
  await page.locator(".legend").waitFor({ state: "detached" });
  await page.getByRole("button", { name: "Color what follows" }).click();
  await until(page, (s) => s.weights);
  await warms(0.9, 1, "the button shows no colors");
  await page.keyboard.press("y");
  await until(page, (s) => !s.weights);
});

/** Save a picture, and return the colors in the image as [red, green, blue, alpha] of the corner and the mean. */
async function picture(item) {
  const [download] = await Promise.all([page.waitForEvent("download"), choose(page, "Picture", item)]);
  const bytes = (await readFile(await download.path())).toString("base64");
  return page
    .evaluate(async (data) => {
      const image = await window.createImageBitmap(
        new window.Blob([Uint8Array.from(window.atob(data), (letter) => letter.charCodeAt(0))]),
      );
      const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
      context.drawImage(image, 0, 0);
      const { data: pixels } = context.getImageData(0, 0, image.width, image.height);
      let [colored, solid] = [0, 0];
      for (let i = 0; i < pixels.length; i += 4) {
        if (pixels[i + 3] > 200) solid++;
        if (Math.max(pixels[i], pixels[i + 1], pixels[i + 2]) - Math.min(pixels[i], pixels[i + 1], pixels[i + 2]) > 90)
          colored++;
      }
      return { corner: [...pixels.slice(0, 4)], colored, solid, size: image.width * image.height };
    }, bytes)
    .catch((error) => ({ error: error.message }));
}

test("a picture has no colors of weights and no gizmo, and no background on request", async () => {
  await page.keyboard.press("0");
  await until(page, (s) => !s.edit.handles[0].moved);
  await warms(0.9, 1, "a handle at rest does not show what follows");
  const plain = await picture("Save a picture");
  assert.equal(plain.corner[3], 255);
  assert.equal(plain.solid, plain.size);
  assert.ok(plain.colored < 20, `${plain.colored} pixels are colored`);
  const cut = await picture("Without background");
  assert.equal(cut.corner[3], 0);
  assert.ok(cut.solid > 0.02 * cut.size && cut.solid < 0.9 * cut.size, `${cut.solid} of ${cut.size} pixels`);
});

test("while points are fixed, colors show what stays", async () => {
  await page.getByRole("button", { name: "Fix points" }).click();
  await until(page, (s) => s.tool === "fix" && s.stays !== null);
  await page.mouse.move(4, 300);
  await warms(0, 0.01, "nothing is fixed yet");
  const { vertex, at } = await visibleVertex(page);
  await page.mouse.move(at[0] + 1, at[1]);
  await page.mouse.move(...at);
  await until(page, (s) => s.probe !== null);
  await warms(0.95, 1, "the pointer does not show what a click would fix");
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.fixed.length === 1);
  await page.mouse.move(4, 300);
  await until(page, (s) => s.probe === null && s.stays?.some((each) => each > 60_000));
  await warms(0.95, 1, "the fixed surface is not shown after the click");
  assert.equal(await state(page, (s) => s.edit.fixed[0].vertex), vertex);
  await shot(page, "fixed");
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.fixed.length === 0);
  await page.keyboard.press("h");
});

test("an unsupported file is refused with what to do", async () => {
  await page.evaluate(() => {
    const files = new window.DataTransfer();
    files.items.add(new window.File(["x"], "cat.fbx"));
    window.dispatchEvent(new window.DragEvent("drop", { dataTransfer: files, cancelable: true }));
  });
  await page.getByText("Open OBJ, PLY, STL, OFF, glTF or GLB; convert FBX with Blender.").waitFor();
});

test("the report is short, is said once, and has details on demand", async () => {
  const field = page.getByLabel("Move y", { exact: true });
  await field.fill("0.1");
  await field.press("Enter");
  await until(page, (s) => s.edit.handles[0].moved && s.report?.details.length > 0);
  const { text, details } = await state(page, (s) => s.report);
  assert.match(text, /moved by 0\.\d+/);
  assert.ok(text.length < 80, text);
  await eventually(async () => assert.equal(await page.getByText(text).count(), 1));
  await page.getByText("What the edit did").click();
  await page.getByText(details[1]).waitFor();
  const step = await page.locator(".step").textContent();
  assert.ok(details[1].includes(`step ${step}`), `${details[1]} and ${step}`);
});

test("after a gesture, proposals are taken by one click or key", async () => {
  await drag(page, [0, -50], -20);
  const buttons = page.getByRole("region", { name: "Proposals" }).getByRole("button");
  await buttons.first().waitFor();
  const proposed = await state(page, (s) => s.proposals.choices.map(({ label, controls }) => ({ label, controls })));
  await shot(page, "proposals");
  assert.ok(proposed.length >= 2, JSON.stringify(proposed));
  const pictures = await state(page, (s) => s.proposals.choices.map((each) => each.picture));
  assert.equal(new Set(pictures).size, pictures.length, "two pictures are equal");
  const before = await state(page, (s) => s.edit.handles[0]);
  const smaller = proposed.findIndex(({ label }) => label === "Smaller");
  assert.ok(smaller >= 0);
  await buttons.nth(smaller).click();
  await until(page, (s, level) => s.edit.handles[0].level === level, proposed[smaller].controls.level);
  const after = await state(page, (s) => s.edit.handles[0]);
  assert.deepEqual(after.translation, before.translation);
  // The next proposals are those of the smaller part.
  await until(page, (s) => s.proposals?.choices.some(({ label }) => label === "Larger"));
  await page.keyboard.press("Control+z");
  await until(page, (s, level) => s.edit.handles[0].level === level, before.level);
  await drag(page, [0, -50], -20);
  await buttons.first().waitFor();
  const [first] = await state(page, (s) => s.proposals.choices.map(({ controls }) => controls));
  await page.keyboard.press("Alt+1");
  await until(page, `(s) => Object.entries(${JSON.stringify(first)}).every(([k, v]) => s.edit.handles[0][k] === v)`);
});

test("who follows is chosen by one click, and the handle moves fewer counterparts", async () => {
  const group = page.getByRole("group", { name: "Who follows" });
  const names = () => group.getByRole("button").allTextContents();
  await eventually(async () => assert.deepEqual(await names(), ["All alike", "Mirrored", "Only this"]));
  for (const [label, follow] of [
    ["Only this", "none"],
    ["All alike", "all"],
  ]) {
    await group.getByRole("button", { name: label }).click();
    await until(page, (s, chosen) => s.edit.handles[0].follow === chosen, follow);
  }
});

test("key poses: chosen, replaced, dragged to another moment, eased", async () => {
  const canvas = () => page.locator("canvas").boundingBox();
  const tall = (await canvas()).height;
  await page.keyboard.press("t");
  await until(page, (s) => s.timeline);
  await eventually(async () => assert.ok((await canvas()).height < tall, "the view does not end above the timeline"));
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 1);
  const field = page.getByLabel("Move y", { exact: true });
  await field.fill("0.3");
  await field.press("Enter");
  await until(page, (s) => s.edit.handles[0].translation[1] === 0.3 && s.ahead.size === 0);
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses.length === 2);
  // The new pose is the chosen one, so the fields change its moment.
  assert.equal(await state(page, (s) => s.pose), 1);
  await page.getByLabel("Seconds", { exact: true }).fill("2");
  await page.getByLabel("Seconds", { exact: true }).press("Enter");
  await until(page, (s) => s.edit.poses[1].seconds === 2);
  const keys = page.getByRole("group", { name: "Poses" }).getByRole("button");
  const { axis, b } = await eventually(async () => {
    const [a, b] = [await keys.nth(0).boundingBox(), await keys.nth(1).boundingBox()];
    const axis = await page.locator(".time-axis").boundingBox();
    assert.ok(Math.abs(b.x - a.x - (2 / 2.2) * axis.width) < 3, "keys are not placed by their times");
    return { axis, b };
  });
  await pull(page, [b.x + 9, b.y + b.height / 2], [-axis.width / 4.4, 0]);
  await until(page, (s) => Math.abs(s.edit.poses[1].seconds - 1.5) < 0.06);
  // Motions ease in and out.
  await page.getByLabel("Moment").fill("0.15");
  const [own, from, to] = await state(page, (s) => [
    [...s.moment.values()][0].translation[1],
    s.edit.poses[0].transforms[0].translation[1],
    s.edit.poses[1].transforms[0].translation[1],
  ]);
  assert.ok((own - from) / (to - from) < 0.05, "the motion does not begin slowly");
  await shot(page, "time_axis");
  // A key on an occupied moment replaces the pose.
  await keys.nth(0).click();
  await page.getByRole("button", { name: "Back to the edit" }).click();
  await page.keyboard.press("k");
  await until(page, (s) => s.edit.poses[0].transforms[0].translation[1] === 0.3);
  assert.equal(await state(page, (s) => s.edit.poses.length), 2);
  await page.keyboard.press("t");
});

test("a new shape begins with the gizmo that moves", async () => {
  await page.keyboard.press("d");
  await until(page, (s) => s.gizmo === "bend");
  await choose(page, "File", "Close");
  await page.getByRole("region", { name: "Samples" }).getByRole("button", { name: "Chair" }).click();
  await until(page, (s) => s.mesh?.name === "Chair");
  assert.equal(await state(page, (s) => s.gizmo), "translate");
});
