// The start page: kept edits have pictures, and are renamed, copied, deleted and restored; samples begin anew.
import assert from "node:assert/strict";

import { choose, drag, eventually, hold, ready, shot, state, story, test, until } from "./page.mjs";

let page, sent;

story((tab) => ({ page, sent } = tab), { shape: false });

const recent = () => page.getByRole("region", { name: "Recent" }).getByRole("listitem");
const sample = () => page.getByRole("region", { name: "Samples" }).getByRole("button", { name: "Chair" }).click();

async function close() {
  await choose(page, "File", "Close");
  await until(page, (s) => s.page === "start");
}

async function openChair() {
  await sample();
  await until(page, (s) => s.mesh?.name === "Chair" && s.edit !== null && s.drawn);
  await ready(page);
}

test("an edit of a sample is kept with a picture, and the sample begins anew", async () => {
  await openChair();
  await hold(page, null, 1);
  await drag(page, [0, -50], -40);
  const { translation } = await state(page, (s) => s.edit.handles[0]);
  await until(page, (s) => s.saved);
  // The picture is made after a rest.
  await eventually(() => assert.ok(sent.includes("keep_picture")));
  await close();
  await eventually(async () => assert.equal(await recent().count(), 1));
  await page.locator(".card.progress").waitFor({ state: "detached" });
  const drawn = await page.locator(".recent img").evaluate((image) => image.decode().then(() => image.naturalWidth));
  assert.equal(drawn, 240);
  await shot(page, "start_recent");
  await openChair();
  assert.equal(await state(page, (s) => s.edit.handles.length), 0);
  await close();
  await recent().first().locator(".opens").click();
  await until(page, (s) => s.edit?.handles.length === 1);
  assert.deepEqual((await state(page, (s) => s.edit.handles[0])).translation, translation);
  await page.getByText("Your edit of this shape is back. Undo begins here.").waitFor();
  await close();
});

test("kept edits are renamed, copied, deleted and restored", async () => {
  await page.getByRole("button", { name: "Rename Chair" }).click();
  await page.locator("input:focus").waitFor();
  await page.keyboard.type("Throne");
  await page.keyboard.press("Enter");
  await page.getByRole("button", { name: "Rename Throne" }).waitFor();
  await page.getByRole("button", { name: "Duplicate Throne" }).click();
  await until(page, (s) => s.recent.length === 2);
  await page.getByRole("button", { name: "Delete Throne copy" }).click();
  await until(page, (s) => s.recent.length === 1);
  await page.getByRole("button", { name: "Undo" }).click();
  await until(page, (s) => s.recent.length === 2);
  await eventually(async () => assert.equal(await recent().count(), 2));
});

test("starting fresh keeps the edit and can be undone", async () => {
  await recent().first().locator(".opens").click();
  await until(page, (s) => s.edit?.handles.length === 1);
  await ready(page);
  await choose(page, "File", "Start fresh");
  await until(page, (s) => s.edit.handles.length === 0);
  await page.keyboard.press("Control+z");
  await until(page, (s) => s.edit.handles.length === 1);
  await close();
  await eventually(async () => assert.equal(await recent().count(), 3));
});
