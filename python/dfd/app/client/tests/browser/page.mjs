// Helpers of the browser tests. They read environment variables: DFD_URL, the address of the app with its token;
// DFD_CHROMIUM, the browser; DFD_SHOTS, a folder for pictures; DFD_MESH and DFD_FIELD, the files of the shape;
// DFD_PATIENCE, the milliseconds to wait for anything.
import assert from "node:assert/strict";
import { mkdirSync } from "node:fs";
import { copyFile, writeFile } from "node:fs/promises";
import { join } from "node:path";
import * as node from "node:test";
import { chromium } from "playwright-core";

const URL_WITH_TOKEN = process.env.DFD_URL;
const SHOTS = process.env.DFD_SHOTS ?? "shots";
export const PATIENCE = Number(process.env.DFD_PATIENCE ?? 60_000);
/** Vertices of parts that look alike: the hooves. */
export const ALIKE = JSON.parse(process.env.DFD_ALIKE ?? "[]");

/** Define a test of a story. */
export const test = (name, run) => node.test(name, { timeout: 5 * PATIENCE }, run);

/**
 * Before the tests of a file, open a tab and pass it to `take`. Unless `shape` is false, open the shape, too, and with
 * `held`, add a handle. After the tests, the page must have reported no errors.
 */
export function story(take, { shape = true, held = false, ...options } = {}) {
  let browser, tab;
  node.before(async () => {
    browser = await launch();
    tab = await openTab(browser, options);
    if (shape) await openShape(tab.page);
    if (held) await hold(tab.page, ALIKE, 1);
    take(tab);
  });
  node.after(async () => {
    await browser?.close();
    assert.deepEqual(tab.problems, []);
  });
}

// SwiftShader renders on the CPU and needs no display.
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

/** Open a tab. The arrays `problems` and `sent` receive all errors in the tab, and the types of its requests. */
export async function openTab(browser, options = {}, address = URL_WITH_TOKEN) {
  const context = await browser.newContext({ viewport: { width: 1440, height: 900 }, ...options });
  const page = await context.newPage();
  await page.addInitScript(installHook);
  // The inspector shows all settings, unless a test stores another choice.
  await page.addInitScript(
    () => window.localStorage.getItem("dfd-more") ?? window.localStorage.setItem("dfd-more", "true"),
  );
  page.setDefaultTimeout(PATIENCE);
  // With a listener from the beginning, the browser surely passes on the first dialog that chooses files.
  page.on("filechooser", () => undefined);
  const [problems, sent] = [[], []];
  page.on("websocket", (socket) => socket.on("framesent", ({ payload }) => sent.push(JSON.parse(payload).type)));
  page.on("pageerror", (error) => problems.push(error.message));
  page.on("console", (message) => {
    if (message.type() === "error") problems.push(message.text());
  });
  await page.goto(address);
  await page.goto(new URL("/?test", address).href);
  await until(page, (s) => s.page !== "waiting");
  return { context, page, problems, sent };
}

/** Replace `window.dfd`, the page's objects for tests, by the functions that the tests call. Runs in the page. */
function installHook() {
  function testFunctions({ store, viewer, ask, drop, posePoint, sceneOf }) {
    const { stage } = viewer;
    const shown = () => {
      if (!viewer.shape) throw new Error("There is no shape yet.");
      return viewer.shape;
    };
    return {
      store,
      /** Send a request, and return the answer. */
      ask,
      /** Close the connection to the server. */
      drop,
      /** Return the shader's posed positions relative to the mesh's center, and the heat, (R, 4). */
      positions() {
        const found = shown().posed.read();
        const error = stage.renderer.getContext().getError();
        if (error !== 0) throw new Error(`WebGL reports error ${error}.`);
        return found;
      },
      /** Return the heat of each row (R). */
      heat() {
        return [...this.positions().filter((_, i) => i % 4 === 3)];
      },
      /** Return the shown positions of all vertices, 3 V numbers in mesh units. */
      shownVertices() {
        const [positions, { mesh }] = [this.positions(), store.get()];
        const posed = Array.from({ length: 3 * mesh.vertices }, () => 0);
        this.vertices().forEach((vertex, row) => {
          for (let i = 0; i < 3; i++) posed[3 * vertex + i] = positions[4 * row + i] + mesh.center[i];
        });
        return posed;
      },
      /** Return the positions at rest (V, 3), relative to the mesh's center. */
      rest() {
        const { vertexOf, positions, message } = shown();
        const rest = new Float32Array(3 * message.vertices);
        vertexOf.forEach((vertex, row) => rest.set(positions.subarray(3 * row, 3 * row + 3), 3 * vertex));
        return rest;
      },
      /** Return the posed positions of the server's kernel (V, 3), relative to the mesh's center. */
      async computed() {
        for (;;) {
          // The server does not answer if the page, too, asks for a pose before the answer.
          const answered = [ask({ type: "compute" }), new Promise((next) => setTimeout(next, 5000))];
          const received = await Promise.race(answered);
          if (received === null) throw new Error("The server computed nothing.");
          if (received) return received.payload.get("positions", "F32");
        }
      },
      /** Return the vertices that would follow the selected handle with other controls, (N). */
      async following(controls) {
        const received = await ask({ type: "preview", handle: store.get().selected, controls });
        const weights = received?.payload.get("values", "U16") ?? [];
        return [...weights.keys()].filter((vertex) => weights[vertex] >= 32768);
      },
      /** Return the vertex of each row (R). */
      vertices: () => shown().vertexOf,
      /** Return the vertex under a pixel of the view. */
      pick: (x, y) => viewer.pick(x, y)?.vertex ?? null,
      /** Return the position of a vertex on the page, in pixels. */
      project(vertex) {
        const row = shown().vertexOf.indexOf(vertex);
        return this.place(posePoint(sceneOf(store.get()), shown().at(row), vertex));
      },
      /** Return the position on the page, in pixels, of a point relative to the mesh's center. */
      place(point) {
        const at = stage.project(point);
        const box = stage.canvas.getBoundingClientRect();
        return at && [at[0] + box.left, at[1] + box.top];
      },
      /** Return whether the gizmo is shown, and so takes the pointer. */
      hasGizmo: () => viewer.gizmo.helper.visible,
      /** Return the position of the gizmo on the page, in pixels. */
      grip() {
        return this.place(viewer.gizmo.proxy.position.toArray());
      },
      camera: () => stage.camera.position.toArray(),
      /** Return the unit vector from the point at the middle of the view to the camera. */
      direction: () => stage.camera.position.clone().sub(stage.orbit.target).normalize().toArray(),
      /** Draw now, so that the canvas can be read in the same task. With `bare`, the shape is not drawn. */
      draw(bare = false) {
        const { group } = shown();
        group.visible = !bare;
        stage.draw();
        group.visible = true;
      },
      /** Return whether the canvas shows the present state. */
      rests: () => stage.rests,
      /** Return an array to which each later picture adds the milliseconds that the page's script takes for it. */
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
    hook = testFunctions(given);
  };
  Object.defineProperty(window, "dfd", { get: () => hook, set });
}

export const state = (page, read) => page.evaluate(`(${read})(window.dfd.store.get())`);

/** Wait up to `patience` milliseconds until `read(state, argument)` is true, and return its result. */
export async function until(page, read, argument = null, patience = PATIENCE) {
  const end = Date.now() + patience;
  for (;;) {
    const text = `window.dfd ? (${read})(window.dfd.store.get(), ${JSON.stringify(argument)}) : false`;
    // While the page reloads, the evaluation fails.
    const found = await page.evaluate(text).catch((error) => {
      if (/destroyed|navigat/i.test(error.message)) return false;
      throw error;
    });
    if (found) return found;
    if (Date.now() > end) {
      const shown = await state(page, (s) => ({ toasts: s.toasts, field: s.edit?.field.status, link: s.link }));
      throw new Error(`This was never true: ${read} with ${JSON.stringify(argument)}; ${JSON.stringify(shown)}`);
    }
    await new Promise((resolve) => setTimeout(resolve, 40));
  }
}

/**
 * Call `check`, which fails or passes, until it passes. Use it for everything that follows from the state: the layout,
 * the pixels and the words of the page change some frames after the state, and weights arrive later still.
 */
export async function eventually(check) {
  const end = Date.now() + PATIENCE / 2;
  for (;;) {
    try {
      return await check();
    } catch (error) {
      if (Date.now() > end) throw error;
    }
    await new Promise((resolve) => setTimeout(resolve, 40));
  }
}

/** Wait until the canvas has kept its place and size for some frames, and shows the present state. */
export function still(page) {
  return page.evaluate(
    () =>
      new Promise((resolve) => {
        const canvas = document.querySelector("canvas");
        let [before, frames] = ["", 0];
        const look = () => {
          const { x, y, width, height } = canvas.getBoundingClientRect();
          const now = [x, y, width, height, canvas.width, canvas.height].join();
          frames = now === before && window.dfd.rests() ? frames + 1 : 0;
          before = now;
          if (frames < 4) requestAnimationFrame(look);
          else resolve();
        };
        look();
      }),
  );
}

/** Open files from the start page. */
export async function open(page, files) {
  const [chooser] = await Promise.all([page.waitForEvent("filechooser"), page.click(".drop")]);
  await chooser.setFiles(files);
  await until(page, (s) => s.page === "shape" && s.edit);
}

/** Open the shape together with its field. */
export async function openShape(page) {
  await open(page, [process.env.DFD_MESH, process.env.DFD_FIELD]);
  await ready(page);
  await until(page, (s) => s.edit.field.parts.length > 0);
}

/** Call `work`, and wait until the server has sent the shape again, as it does after every new connection. */
export async function shapeSentAgain(page, work) {
  await page.evaluate(() => (window.before = window.dfd.store.get().mesh));
  await work();
  await until(page, (s) => s.mesh !== null && s.mesh !== window.before && s.edit !== null);
}

/** Wait until handles can be added. */
export async function ready(page) {
  await until(page, (s) => s.edit?.field.status === "ready");
}

/** Choose an item of a menu. */
export async function choose(page, menu, item) {
  await page.getByRole("button", { name: menu }).click();
  await page.getByRole("menuitem", { name: item }).click();
}

/** Export in a format, check the name of the file, and keep the file under the name `kept` for the checks in Python. */
export async function exportFile(page, format, name, kept = name) {
  const [download] = await Promise.all([
    page.waitForEvent("download"),
    choose(page, "Export", new RegExp(`^${format}`)),
  ]);
  assert.equal(download.suggestedFilename(), name);
  await page.getByText(`${name} is saved`).waitFor();
  await copyFile(await download.path(), join(process.env.DFD_OUT, kept));
}

/** Write the shown positions for the checks in Python. */
export async function writeShown(page, name) {
  const shown = await page.evaluate(() => window.dfd.shownVertices());
  await writeFile(join(process.env.DFD_OUT, name), JSON.stringify(shown));
}

/** Start to learn the features, unless they are cached or already being learned. */
export async function learn(page) {
  const button = page.getByRole("button", { name: "Learn features" });
  const end = Date.now() + PATIENCE;
  while ((await state(page, (s) => s.edit?.field.status)) === "none" && Date.now() < end) {
    if (await button.isVisible()) await button.click({ timeout: 1000 }).catch(() => undefined);
    await new Promise((resolve) => setTimeout(resolve, 100));
  }
  await until(page, (s) => s.edit?.field.status !== "none");
}

/** Return a visible vertex, of the vertices `among` if given, and its pixel in the page. */
export async function visibleVertex(page, among = null) {
  await still(page);
  const found = await page.evaluate((wanted) => {
    const element = document.querySelector("canvas");
    const canvas = element.getBoundingClientRect();
    let covered = null; // a visible vertex under a panel or a mark, where a click does not reach the canvas
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
  if (!found) throw new Error("No vertex is visible.");
  return found;
}

/**
 * Click a visible vertex until there are `count` handles, and return the vertex. One click may not be enough, because
 * the layout of the page can change between the search for the vertex and the click.
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
    if (Date.now() > end) throw new Error(`A click on vertex ${vertex}, pixel ${at}, added no handle.`);
  }
}

/** Drag an arrow of the gizmo by `distance` pixels. The arrow is (x, y) pixels from the selected handle. */
export async function drag(page, [x, y], distance, during = async () => {}) {
  await still(page);
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

/** Press at a pixel, move the pointer by (x, y) pixels, and release it. */
export async function pull(page, from, [x, y], during = async () => {}) {
  await still(page);
  await page.mouse.move(from[0] + 2, from[1]);
  await page.mouse.move(...from);
  await page.waitForTimeout(80);
  await page.mouse.down();
  for (let i = 1; i <= 8; i++) await page.mouse.move(from[0] + (x * i) / 8, from[1] + (y * i) / 8);
  await during();
  await page.mouse.up();
  await until(page, (s) => !s.dragging && s.ahead.size === 0);
}

export function shot(page, name) {
  mkdirSync(SHOTS, { recursive: true });
  return page.screenshot({ path: join(SHOTS, `${name}.png`) });
}

/**
 * Return the share of the canvas that the shape covers, and the number of colors and the mean lightness there; all are 0
 * for a blank canvas.
 */
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
          let [covered, light] = [0, 0];
          for (let i = 0; i < pixels.length; i += 4) {
            if ([0, 1, 2].every((k) => pixels[i + k] === bare[i + k])) continue;
            covered++;
            light += (pixels[i] + pixels[i + 1] + pixels[i + 2]) / 765;
            shades.add((pixels[i] << 16) | (pixels[i + 1] << 8) | pixels[i + 2]);
          }
          resolve({ covered: covered / (width * height), shades: shades.size, light: light / Math.max(covered, 1) });
        });
      }),
  );
}

/**
 * Return the largest distance between the shader's and the kernel's positions, divided by the shape's diagonal. New
 * weights arrive some time after a change, so the function waits up to 20 seconds until the distance is small.
 */
export function shaderError(page) {
  return page.evaluate(async () => {
    const { diagonal } = window.dfd.store.get().mesh;
    const vertices = window.dfd.vertices();
    for (const patience = performance.now() + 20_000; ; await new Promise((next) => setTimeout(next, 50))) {
      const kernel = await window.dfd.computed();
      const shader = window.dfd.positions();
      let worst = 0;
      vertices.forEach((vertex, row) => {
        for (let i = 0; i < 3; i++) {
          const off = Math.abs(kernel[3 * vertex + i] - shader[4 * row + i]) / diagonal;
          // This comparison also counts NaN as an error.
          if (!(off <= worst)) worst = off;
        }
      });
      if (worst <= 1e-4 || performance.now() > patience) return worst;
    }
  });
}
