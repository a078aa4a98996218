// Open a mesh without a field. The page shows it at once, learns its features, and then handles can be added.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { ready, drawn, launch, learn, open, openTab, PATIENCE, shot, until, visibleVertex } from "./page.mjs";

let browser, page, problems;

before(async () => {
  browser = await launch();
  ({ page, problems } = await openTab(browser));
});

after(() => browser?.close());

test("a mesh is visible during the learning, and then a click adds a handle", { timeout: 2 * PATIENCE }, async () => {
  await open(page, process.env.DFD_MESH);
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  await learn(page);
  await shot(page, "learning");
  await ready(page);
  const { at } = await visibleVertex(page);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  assert.deepEqual(problems, []);
});
