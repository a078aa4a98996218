// Open a mesh without a field. The page shows it at once, learns its features, and then handles can be added.
import assert from "node:assert/strict";

import { drawn, hold, learn, open, PATIENCE, ready, shot, state, story, test, until, visibleVertex } from "./page.mjs";

let page;

story((tab) => ({ page } = tab), { shape: false });

test("a mesh is visible during the learning, and then a click adds a handle", async () => {
  await open(page, process.env.DFD_MESH);
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  await learn(page);
  await shot(page, "learning");
  await ready(page);
  // Until the features are learned, the pointer shows parts of the geometry. Then these must not stay.
  const { vertex, at } = await visibleVertex(page);
  const early = await state(page, (s) => s.edit.field.origin === "geometry");
  if (early) {
    await page.mouse.move(at[0] + 1, at[1]);
    await page.mouse.move(...at);
    // The features may be learned before the parts of the geometry are known.
    await until(
      page,
      (s) => s.edit.field.origin === "distilled" || (window.early = s.ladders.get(s.probe?.vertex)) !== undefined,
      null,
      3 * PATIENCE,
    );
  }
  await until(page, (s) => s.edit.field.origin === "distilled", null, 3 * PATIENCE);
  if (early) await until(page, (s) => ![undefined, window.early].includes(s.ladders.get(s.probe?.vertex)));
  await hold(page, [vertex], 1);
  await until(page, (s) => s.columns.size > 0);
});
