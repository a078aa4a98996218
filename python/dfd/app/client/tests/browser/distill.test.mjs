// A mesh without a field: it is seen at once, its features are learned under the eyes of the person, and it comes alive.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { alive, drawn, launch, learn, open, openTab, PATIENCE, shot, until, visibleVertex } from "./page.mjs";

let browser, page, problems;

before(async () => {
  browser = await launch();
  ({ page, problems } = await openTab(browser));
});

after(() => browser?.close());

test("a mesh is seen while its features are learned, and then can be held", { timeout: 2 * PATIENCE }, async () => {
  await open(page, process.env.DFD_MESH);
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  await learn(page);
  await shot(page, "learning");
  await alive(page);
  const { at } = await visibleVertex(page);
  await page.mouse.click(...at);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
  assert.deepEqual(problems, []);
});
