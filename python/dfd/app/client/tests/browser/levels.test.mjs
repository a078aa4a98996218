// A large shape where drawing is slow: coarse while something moves, whole as soon as it rests, and the numbers the same.
import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import {
  alive,
  drag,
  drawn,
  launch,
  open,
  openTab,
  PATIENCE,
  shaderError,
  shot,
  state,
  until,
  visibleVertex,
} from "./page.mjs";

const TOLERANCE = 1e-4;
const SLOW = 100;
const LONG = 1000;
let browser, context, page, problems, faces;

before(async () => {
  browser = await launch();
  ({ context, page, problems } = await openTab(browser, { colorScheme: "light" }));
});

after(() => browser?.close());

const whole = () => until(page, (s) => s.seen === "full" && window.dfd.rests());
const pretend = (milliseconds) => page.evaluate((ms) => window.dfd.pretend(ms), milliseconds);
const triangles = () => page.evaluate(() => window.dfd.triangles());
const coarseWord = () => page.getByText("Coarse while moving");

test("the coarse level comes first, and the whole after it", { timeout: 2 * PATIENCE }, async () => {
  await open(page, [process.env.DFD_LARGE, process.env.DFD_FIELD]);
  await alive(page);
  assert.equal(await state(page, (s) => s.mesh.coarse), true);
  await whole();
  faces = await state(page, (s) => s.mesh.faces);
  const rest = await page.evaluate(() => window.dfd.vertices().length);
  assert.equal(rest, await state(page, (s) => s.mesh.vertices));
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  assert.ok((await shaderError(page)) <= TOLERANCE);
});

test(
  "a drag draws the coarse level, and its end the whole, as the kernel poses it",
  { timeout: 2 * PATIENCE },
  async () => {
    await pretend(SLOW);
    const { at, vertex } = await visibleVertex(page);
    await page.mouse.click(...at);
    await until(page, (s) => s.edit.handles.length === 1 && s.columns.size > 0);
    assert.equal(await state(page, (s) => s.edit.handles[0].vertex), vertex);
    await page.mouse.move(4, 600);
    await whole();
    await drag(page, [0, -50], -60, async () => {
      await until(page, (s) => s.dragging && s.seen === "coarse");
      await coarseWord().waitFor();
      assert.ok((await triangles()) < faces / 2, "the whole was drawn");
      await shot(page, "coarse");
    });
    await until(page, (s) => s.seen === "full" && s.edit.handles[0].moved);
    await coarseWord().waitFor({ state: "hidden" });
    assert.ok((await shaderError(page)) <= TOLERANCE);
    await shot(page, "whole");
  },
);

/** The part of the pixels in which the picture at rest differs from the whole drawn at once. */
function difference() {
  return page.evaluate(() => {
    const canvas = document.querySelector("canvas");
    window.dfd.drawNext();
    const { width, height } = canvas;
    const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
    const [still, direct] = [() => window.dfd.drawNext(), () => window.dfd.draw()].map((draw) => {
      draw();
      copy.drawImage(canvas, 0, 0);
      return copy.getImageData(0, 0, width, height).data;
    });
    let different = 0;
    for (let i = 0; i < still.length; i += 4) {
      if ([0, 1, 2].some((k) => Math.abs(still[i + k] - direct[i + k]) > 2)) different++;
    }
    return different / (width * height);
  });
}

for (const [way, milliseconds] of [
  ["at once", SLOW],
  ["bit by bit", LONG],
]) {
  test(`what is drawn ${way} at rest is what is drawn otherwise`, { timeout: PATIENCE }, async () => {
    await pretend(milliseconds);
    await page.mouse.move(700, 850);
    await page.mouse.down();
    for (let i = 1; i <= 6; i++) await page.mouse.move(700 + 9 * i, 850);
    await until(page, (s) => s.seen === "coarse");
    await page.mouse.up();
    await whole();
    for (const wireframe of [false, true]) {
      await page.evaluate((on) => window.dfd.store.set({ wireframe: on, look: on ? "clay" : "texture" }), wireframe);
      await page.evaluate(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))));
      await whole();
      const part = await difference();
      // Beside the shape the picture at rest has no depth, so half of a line along the silhouette stays away.
      assert.ok(part < (wireframe ? 3e-3 : 1e-4), `${part} of the pixels differ, wireframe ${wireframe}`);
    }
  });
}

test("what is picked is what is seen", { timeout: PATIENCE }, async () => {
  await page.evaluate(() => window.dfd.store.set({ wireframe: false, look: "texture" }));
  await whole();
  // A vertex of the whole that is none of the coarse level's, whose rows come first.
  const fine = await page.evaluate(() => Array.from(window.dfd.vertices().slice(-2000)));
  const { vertex } = await visibleVertex(page, fine);
  assert.ok(fine.includes(vertex));
});

test(
  "after a drag and its undo the whole is seen, and posing beside it leaves the canvas alone",
  { timeout: PATIENCE },
  async () => {
    await page.evaluate(() => {
      const gl = document.querySelector("canvas").getContext("webgl2");
      const draw = gl.drawArrays.bind(gl);
      window.onCanvas = 0;
      gl.drawArrays = (...arguments_) => {
        if (gl.isEnabled(gl.RASTERIZER_DISCARD) && !gl.getParameter(gl.FRAMEBUFFER_BINDING)) window.onCanvas++;
        draw(...arguments_);
      };
    });
    await drag(page, [0, -50], -60);
    await page.keyboard.press("Control+z");
    await until(page, (s) => s.edit.can_redo);
    await whole();
    assert.ok((await difference()) < 1e-4);
    assert.equal(await page.evaluate(() => window.onCanvas), 0);
  },
);

test("full quality is a key away, lowers nothing, and is remembered", { timeout: 2 * PATIENCE }, async () => {
  await page.keyboard.press("q");
  await until(page, (s) => s.quality === "full");
  await drag(page, [0, -50], -30, async () => {
    await page.waitForTimeout(200);
    assert.equal(await state(page, (s) => s.seen), "full");
  });
  await page.reload();
  await until(page, (s) => s.edit?.handles.length === 1);
  assert.equal(await state(page, (s) => s.quality), "full");
  await page.getByRole("button", { name: "Full quality while moving" }).click();
  await until(page, (s) => s.quality === "auto");
});

test("graphics that were lost come back as they were", { timeout: 2 * PATIENCE }, async () => {
  await alive(page);
  await until(page, (s) => s.edit.handles.length === 1 && s.columns.has(s.edit.handles[0].column));
  await whole();
  await page.evaluate(async () => {
    const canvas = document.querySelector("canvas");
    const heard = (name) => new Promise((resolve) => canvas.addEventListener(name, resolve, { once: true }));
    const gone = canvas.getContext("webgl2").getExtension("WEBGL_lose_context");
    const lost = heard("webglcontextlost");
    gone.loseContext();
    await lost;
    // Browsers restore no context in the task in which it was lost.
    await new Promise((resolve) => setTimeout(resolve, 100));
    const restored = heard("webglcontextrestored");
    gone.restoreContext();
    await restored;
  });
  await whole();
  await page.waitForTimeout(500);
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  assert.ok((await shaderError(page)) <= TOLERANCE);
  assert.ok((await difference()) < 1e-4);
  await visibleVertex(page);
  await shot(page, "restored");
});

test("the coarse level looks right in the dark, too", { timeout: PATIENCE }, async () => {
  await page.emulateMedia({ colorScheme: "dark" });
  await page.keyboard.press("n");
  await until(page, (s) => s.selected !== null);
  await pretend(SLOW);
  await drag(page, [0, -50], -30, async () => {
    await until(page, (s) => s.seen === "coarse");
    assert.ok((await triangles()) > 1000, "nothing was drawn");
    await shot(page, "coarse-dark");
  });
  await whole();
  const seen = await drawn(page);
  assert.ok(seen.covered > 0.03 && seen.shades > 50, `the canvas is blank: ${JSON.stringify(seen)}`);
  await shot(page, "whole-dark");
  await context.close();
});

test("nothing went wrong on the way", () => {
  assert.deepEqual(problems, []);
});
