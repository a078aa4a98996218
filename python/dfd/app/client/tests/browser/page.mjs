// The page in a real browser, as the tests use it. From the environment: DFD_URL, the address with its token;
// DFD_CHROMIUM, the browser; DFD_SHOTS, a folder for pictures.
import { mkdirSync } from "node:fs";
import { join } from "node:path";
import { chromium } from "playwright-core";

const URL_WITH_TOKEN = process.env.DFD_URL;
const SHOTS = process.env.DFD_SHOTS ?? "shots";
export const PATIENCE = 60_000;

// SwiftShader needs no display; Mesa's llvmpipe under Xvfb draws about twice as fast, where there is one.
const FLAGS = [
  "--no-sandbox",
  "--disable-quic",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
];

export function launch() {
  return chromium.launch({ executablePath: process.env.DFD_CHROMIUM ?? "/usr/bin/chromium", args: FLAGS });
}

/** A tab that keeps what went wrong in it in `problems`. */
export async function openTab(browser, options = {}) {
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, ...options });
  const page = await context.newPage();
  await page.addInitScript(installHook);
  // What the inspector folds away is there unless a story is about that.
  await page.addInitScript(
    () => window.localStorage.getItem("dfd-more") ?? window.localStorage.setItem("dfd-more", "true"),
  );
  page.setDefaultTimeout(PATIENCE);
  const problems = [];
  page.on("pageerror", (error) => problems.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(message.text());
  });
  await page.goto(URL_WITH_TOKEN);
  await page.goto(new URL("/?test", URL_WITH_TOKEN).href);
  await until(page, (s) => s.page !== "waiting");
  return { context, page, problems };
}

/** Runs in the page: turns what it gives to tests, `window.dfd`, into what they ask. */
function installHook() {
  function asked({ store, viewer, ask, drop, posePoint, sceneOf }) {
    const { stage } = viewer;
    const shown = () => {
      if (!viewer.shape) throw new Error("There is no shape yet.");
      return viewer.shape;
    };
    return {
      store,
      /** Lose the connection to the server, as a network does. */
      drop,
      /** (R, 4) posed positions relative to the mesh's center, and heat, as the shader has them. */
      positions() {
        const found = shown().posed.read();
        const error = stage.renderer.getContext().getError();
        if (error !== 0) throw new Error(`The graphics refused something: ${error}`);
        return found;
      },
      /** (V, 3) positions at rest, relative to the mesh's center. */
      rest() {
        const { vertexOf, positions, message } = shown();
        const rest = new Float32Array(3 * message.vertices);
        vertexOf.forEach((vertex, row) => rest.set(positions.subarray(3 * row, 3 * row + 3), 3 * vertex));
        return rest;
      },
      /** (V, 3) positions relative to the mesh's center, as the server's kernel has them. */
      async computed() {
        const received = await ask({ type: "compute" });
        if (!received) throw new Error("The server computed nothing.");
        return received.payload.get("positions", "F32");
      },
      /** (R) the vertex of each row. */
      vertices: () => shown().vertexOf,
      /** The vertex under a pixel of the view. */
      pick: (x, y) => viewer.pick(x, y)?.vertex ?? null,
      /** Where a vertex appears, in pixels of the page. */
      project(vertex) {
        const row = shown().vertexOf.indexOf(vertex);
        return this.place(posePoint(sceneOf(store.get()), shown().at(row), vertex));
      },
      /** Where a point, relative to the mesh's center, appears in pixels of the page. */
      place(point) {
        const at = stage.project(point);
        const box = stage.canvas.getBoundingClientRect();
        return at && [at[0] + box.left, at[1] + box.top];
      },
      camera: () => stage.camera.position.toArray(),
      /** Draw now, so that the canvas can be read in the same task; without the shape where `bare`. */
      draw(bare = false) {
        const { group } = shown();
        group.visible = !bare;
        stage.draw();
        group.visible = true;
      },
      /** Whether nothing is left to be drawn. */
      rests: () => stage.rests,
      /** Milliseconds of the page's own script in every picture from now on. */
      drawingTimes() {
        const times = [];
        const draw = stage.draw.bind(stage);
        stage.draw = () => {
          const begun = performance.now();
          draw();
          times.push(performance.now() - begun);
        };
        return times;
      },
    };
  }
  let hook;
  const set = (given) => {
    hook = asked(given);
  };
  Object.defineProperty(window, "dfd", { get: () => hook, set });
}

export const state = (page, read) => page.evaluate(`(${read})(window.dfd.store.get())`);

/** Ask again and again from here: the page's own policy lets nobody evaluate texts in it. */
export async function until(page, read, argument = null) {
  const end = Date.now() + PATIENCE;
  for (;;) {
    const text = `window.dfd ? (${read})(window.dfd.store.get(), ${JSON.stringify(argument)}) : false`;
    // While the page is exchanged there is nothing to ask.
    const found = await page.evaluate(text).catch((error) => {
      if (/destroyed|navigat/i.test(error.message)) return false;
      throw error;
    });
    if (found) return found;
    if (Date.now() > end) {
      const shown = await state(page, (s) => ({ toasts: s.toasts, field: s.edit?.field.status, link: s.link }));
      throw new Error(`It never became true: ${read} of ${JSON.stringify(argument)}; ${JSON.stringify(shown)}`);
    }
    await new Promise((resolve) => setTimeout(resolve, 40));
  }
}

/** Open files from the start page. */
export async function open(page, files) {
  const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.click(".drop")]);
  await chooser.setFiles(files);
  await until(page, (s) => s.page === "shape" && s.edit);
}

/** Open the shape with the field that it has. */
export async function openShape(page) {
  await open(page, [process.env.DFD_MESH, process.env.DFD_FIELD]);
  await alive(page);
}

/** Do `work`, and wait until the shape has come anew, as it does with every new connection. */
export async function anew(page, work) {
  await page.evaluate(() => (window.before = window.dfd.store.get().mesh));
  await work();
  await until(page, (s) => s.mesh !== null && s.mesh !== window.before && s.edit !== null);
}

export async function alive(page) {
  await until(page, (s) => s.edit?.field.status === "ready");
}

/** Have the features learned, unless they are there or on their way: a known shape has them in a moment. */
export async function learn(page) {
  const button = page.getByRole("button", { name: "Learn features" });
  const end = Date.now() + PATIENCE;
  while ((await state(page, (s) => s.edit?.field.status)) === "none" && Date.now() < end) {
    if (await button.isVisible()) await button.click({ timeout: 1000 }).catch(() => undefined);
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  await until(page, (s) => s.edit?.field.status !== "none");
}

/** The pixel, in the page, of a vertex that can be seen there. */
export async function visibleVertex(page, among = null) {
  const found = await page.evaluate((wanted) => {
    const element = document.querySelector("canvas");
    const canvas = element.getBoundingClientRect();
    let covered = null; // by a panel: a click there does not reach the shape
    const count = window.dfd.store.get().mesh.vertices;
    const vertices = wanted ?? Array.from({ length: 60 }, (_, i) => Math.floor(((i + 0.5) / 60) * count));
    for (const vertex of vertices) {
      const at = window.dfd.project(vertex);
      if (!at || window.dfd.pick(at[0] - canvas.left, at[1] - canvas.top) !== vertex) continue;
      if (document.elementFromPoint(...at) === element) return { vertex, at };
      covered ??= { vertex, at };
    }
    return covered;
  }, among);
  if (!found) throw new Error("No vertex can be seen.");
  return found;
}

/**
 * Click a vertex that can be seen until there are `count` handles, and return it: the page may be laid out anew between
 * a look and a click, and a person would click again.
 */
export async function hold(page, among, count) {
  const end = Date.now() + PATIENCE;
  for (;;) {
    const { vertex, at } = await visibleVertex(page, among);
    await page.mouse.click(...at);
    for (const again = Date.now() + 8000; Date.now() < again;) {
      if (await state(page, `(s) => s.edit.handles.length === ${count}`)) return vertex;
      await page.waitForTimeout(40);
    }
    if (Date.now() > end) throw new Error(`Nothing was taken hold of at vertex ${vertex}, pixel ${at}.`);
  }
}

/** Pull an arm of the gizmo of the selected handle: (x, y) is the way from its center, in pixels. */
export async function drag(page, [x, y], distance, during = async () => {}) {
  const center = await page.evaluate(() => {
    const { selected, edit } = window.dfd.store.get();
    return window.dfd.project(edit.handles.find((handle) => handle.handle === selected).vertex);
  });
  const size = Math.hypot(x, y);
  const to = (pixels) => [center[0] + (x / size) * pixels, center[1] + (y / size) * pixels];
  await page.mouse.move(...to(size - 4));
  await page.mouse.move(...to(size));
  await page.waitForTimeout(50);
  await page.mouse.down();
  for (let i = 1; i <= 6; i++) await page.mouse.move(...to(size + (distance * i) / 6));
  await during();
  await page.mouse.up();
  await until(page, (s) => !s.dragging && s.ahead.size === 0);
}

export function shot(page, name) {
  mkdirSync(SHOTS, { recursive: true });
  return page.screenshot({ path: join(SHOTS, `${name}.png`) });
}

/** Part of the canvas's pixels that the shape covers, and how many shades those have: a blank canvas has none of either. */
export function drawn(page) {
  return page.evaluate(
    () =>
      new Promise((resolve) => {
        requestAnimationFrame(() => {
          const canvas = document.querySelector("canvas");
          const { width, height } = canvas;
          const copy = new OffscreenCanvas(width, height).getContext("2d", { willReadFrequently: true });
          const [bare, pixels] = [true, false].map((without) => {
            window.dfd.draw(without);
            copy.drawImage(canvas, 0, 0);
            return copy.getImageData(0, 0, width, height).data;
          });
          const shades = new Set();
          let covered = 0;
          for (let i = 0; i < pixels.length; i += 4) {
            if ([0, 1, 2].every((k) => pixels[i + k] === bare[i + k])) continue;
            covered++;
            shades.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
          }
          resolve({ covered: covered / (width * height), shades: shades.size });
        });
      }),
  );
}

/**
 * Largest difference between the shader's positions and the kernel's, over the shape's diagonal: columns, and the gains
 * of counterparts, come a moment after what they follow from, so that it is given time to vanish.
 */
export function shaderError(page) {
  return page.evaluate(async () => {
    const { diagonal } = window.dfd.store.get().mesh;
    const vertices = window.dfd.vertices();
    for (const patience = performance.now() + 5000; ; await new Promise((next) => setTimeout(next, 50))) {
      const kernel = await window.dfd.computed();
      const shader = window.dfd.positions();
      let worst = 0;
      vertices.forEach((vertex, row) => {
        for (let i = 0; i < 3; i++) {
          const off = Math.abs(kernel[3 * vertex + i] - shader[4 * row + i]) / diagonal;
          // Also what is no number is an error.
          if (!(off <= worst)) worst = off;
        }
      });
      if (worst <= 1e-4 || performance.now() > patience) return worst;
    }
  });
}
