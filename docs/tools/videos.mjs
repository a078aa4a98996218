// Films the app's gestures, a picture at a time: a pointer is drawn where the mouse is, and each picture waits until all
// is there that it shows. From the environment: DFD_URL, a server without a mesh; DFD_CHROMIUM; DFD_CLIENT, the client's
// folder; DFD_SHAPES, the folder of meshes with their fields; DFD_OUT, which gets a folder of pictures for each film
// that DFD_FILMS names.
import { mkdirSync, writeFileSync } from "node:fs";
import { join } from "node:path";
import { pathToFileURL } from "node:url";

const { DFD_CLIENT, DFD_OUT, DFD_SHAPES, DFD_FILMS } = process.env;
const { alive, launch, open, openTab, until } = await import(
  pathToFileURL(join(DFD_CLIENT, "tests/browser/page.mjs")).href
);

const ARROW = "M2 1v21l5.2-4.6 3.4 7.8 3.6-1.6-3.4-7.6 7-.4z";

const INSPECTOR = 296; // pixels
const HOOF = [0.125, 0.02, 0.28];
const HORN = [0.131, 1.119, 0.495];
const MUZZLE = [0.02, 0.805, 0.69];

/** A film of a shape in the page. */
class Film {
  count = 0;
  at = [0, 0];

  constructor(page, name) {
    this.page = page;
    this.folder = join(DFD_OUT, name);
    mkdirSync(this.folder, { recursive: true });
  }

  /** Show nothing but the shape, and a pointer over it. */
  async begin([x, y], steps) {
    const { page } = this;
    const view = await page.locator(".view").boundingBox();
    const corner = [view.x + 0.1 * view.width, view.y + 0.9 * view.height];
    await page.mouse.move(...corner);
    await page.mouse.down();
    for (let i = 1; i <= 10; i++) await page.mouse.move(corner[0] + (x * i) / 10, corner[1] + (y * i) / 10);
    await page.mouse.up();
    await page.mouse.move(view.x + 0.5 * view.width, view.y + (steps < 0 ? 0.2 : 0.5) * view.height);
    for (let i = 0; i < Math.abs(steps); i++) await page.mouse.wheel(0, -100 * Math.sign(steps));
    await page.waitForTimeout(1500);
    this.at = [view.x + 0.75 * view.width, view.y + 0.85 * view.height];
    await page.mouse.move(...this.at);
    await this.page.evaluate((arrow) => {
      window.dfd.store.set({ quality: "full" });
      const pointer = document.createElement("div");
      const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
      const keys = document.createElement("span");
      path.setAttribute("d", arrow);
      Object.assign(pointer.style, { position: "fixed", left: 0, top: 0, zIndex: 99, pointerEvents: "none" });
      Object.assign(svg.style, { width: "40px", height: "44px", overflow: "visible", position: "absolute" });
      Object.assign(path.style, { fill: "#111", stroke: "#fff", strokeWidth: 1.6, transform: "scale(1.25)" });
      Object.assign(keys.style, {
        ...{ position: "absolute", left: "34px", top: "20px", padding: "3px 12px", borderRadius: "6px" },
        ...{ background: "#1a2030", color: "#fff", font: "600 20px sans-serif", whiteSpace: "nowrap" },
      });
      svg.append(path);
      pointer.append(svg, keys);
      document.body.append(pointer);
      window.point = ([x, y], down, key) => {
        pointer.style.transform = `translate(${x - 2}px, ${y - 1}px)`;
        svg.style.filter = down ? "drop-shadow(0 0 5px #3152d4) drop-shadow(0 0 3px #3152d4)" : "";
        keys.textContent = key;
        keys.hidden = key === "";
      };
    }, ARROW);
  }

  down = false;
  key = "";

  /** Wait until all is drawn, and keep so many pictures of it. */
  async picture(times = 1) {
    await this.page.evaluate(([at, down, key]) => window.point(at, down, key), [this.at, this.down, this.key]);
    await until(this.page, () => window.dfd.rests());
    await this.page.evaluate(
      () => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(resolve))),
    );
    const view = await this.page.locator(".view").boundingBox();
    const clip = { ...view, width: view.width + (this.inspector ? INSPECTOR : 0) };
    const image = await this.page.screenshot({ clip });
    for (let i = 0; i < times; i++)
      writeFileSync(join(this.folder, `${String(this.count++).padStart(3, "0")}.png`), image);
  }

  /** What the film shows before it plays. */
  poster() {
    writeFileSync(join(this.folder, "poster"), String(this.count - 1));
  }

  /** Move the mouse there in so many pictures, slowly at both ends. */
  async go(to, pictures) {
    const from = this.at;
    for (let i = 1; i <= pictures; i++) {
      const part = (1 - Math.cos((Math.PI * i) / pictures)) / 2;
      this.at = [0, 1].map((k) => from[k] + part * (to[k] - from[k]));
      await this.page.mouse.move(...this.at);
      await this.picture();
    }
  }

  async press(down) {
    await (down ? this.page.mouse.down() : this.page.mouse.up());
    this.down = down;
    await this.picture(2);
  }

  async click() {
    await this.press(true);
    await this.press(false);
  }

  /** Where the vertex is seen that is nearest to a place of the mesh among those that can be pointed at. */
  place(position) {
    return this.page.evaluate((wanted) => {
      const { center } = window.dfd.store.get().mesh;
      const rest = window.dfd.rest();
      const box = document.querySelector("canvas").getBoundingClientRect();
      const away = (v) => Math.hypot(...wanted.map((x, i) => x - center[i] - rest[3 * v + i]));
      const vertices = Array.from({ length: rest.length / 3 }, (_, v) => [away(v), v]).sort((a, b) => a[0] - b[0]);
      for (const [, vertex] of vertices) {
        const [x, y] = window.dfd.project(vertex).map(Math.round);
        if (window.dfd.pick(x - box.left, y - box.top) === vertex) return [x, y];
      }
      throw new Error("No vertex can be seen.");
    }, position);
  }

  /** Point at a place, and click; `before` is done unseen. */
  async hold(position, before = async () => {}) {
    await this.go(await this.place(position), 10);
    await this.until((s) => s.probe !== null);
    await this.picture(6);
    await this.click();
    await this.until((s) => s.edit.handles.length === 1 && s.columns.has(s.edit.handles[0].column));
    await before();
    await this.page.mouse.move(...this.at);
    await this.page.locator(".tip").waitFor({ state: "detached" });
    await this.picture(4);
  }

  /** Drag what lies so many pixels from the gizmo's center. */
  async drag(from, way) {
    const center = await this.page.evaluate(() => {
      const { axis, edit, gizmo, mesh } = window.dfd.store.get();
      if (gizmo === "bend") return window.dfd.place(axis.tip.map((x, i) => x - mesh.center[i]));
      return window.dfd.project(edit.handles[0].vertex);
    });
    const begin = [0, 1].map((k) => center[k] + from[k]);
    await this.go(begin, 5);
    await this.press(true);
    await this.go(
      [0, 1].map((k) => begin[k] + way[k]),
      20,
    );
    this.poster();
    await this.press(false);
    await this.until((s) => !s.dragging && s.ahead.size === 0);
    await this.picture(10);
  }

  /** Have what is held reach by a number. */
  async reach(number) {
    await this.page.getByRole("group", { name: "Reach by" }).getByRole("button", { name: "Number" }).click();
    await this.page.getByLabel("Reach", { exact: true }).fill(number);
    await this.until((s, wanted) => s.edit.handles[0].reach === wanted && s.ahead.size === 0, Number(number));
  }

  /** Click a switch of the inspector. */
  async choose(control) {
    const box = await control.boundingBox();
    await this.go([box.x + box.width - 12, box.y + box.height / 2], 12);
    await this.click();
  }

  /** Press a key, which is shown for a while. */
  async type(key, shown) {
    await this.page.keyboard.press(key);
    this.key = shown;
    await this.picture(9);
    this.key = "";
  }

  until(read, argument) {
    return until(this.page, read, argument);
  }
}

const SCENES = {
  /** What would follow lights up under the pointer. */
  async point(film) {
    for (const place of [HOOF, HORN, MUZZLE]) {
      await film.go(await film.place(place), 9);
      await film.until((s) => s.probe !== null);
      await film.picture(14);
      if (place === HOOF) film.poster();
    }
  },

  /** One foot is held and pulled: all four legs grow. */
  async pull(film) {
    await film.hold([0.235, 0.05, 0.25]);
    await film.drag([0, 36], [0, 62]);
  },

  /** A tail follows its tip. */
  async bend(film) {
    await film.hold([0, 0.25, -0.55]);
    await film.type("d", "D");
    await film.until((s) => s.axis?.tip);
    await film.drag([0, 0], [75, -75]);
  },

  /** The face follows the horns until a place on it is fixed. */
  async fix(film) {
    await film.hold(HORN, () => film.reach("1"));
    await film.drag([0, -36], [0, -50]);
    await film.type("x", "X");
    await film.go(await film.place(MUZZLE), 12);
    await film.click();
    await film.until((s) => s.edit.fixed.length === 1 && s.columns.has(s.edit.fixed_column));
    await film.picture(20);
    film.poster();
  },

  /** Neck and chest follow the muzzle until it is limited to its part. */
  async limit(film) {
    const limit = film.page.getByLabel("Limit to part").locator("xpath=..");
    film.inspector = true;
    await film.hold(MUZZLE, async () => {
      await film.reach("1.2");
      await limit.scrollIntoViewIfNeeded();
    });
    await film.drag([0, -36], [0, -45]);
    await film.choose(limit);
    await film.until((s) => s.edit.handles[0].mask_part && s.columns.has(s.edit.handles[0].column));
    await film.picture(18);
    film.poster();
  },

  /** With a plane of symmetry both hands go out. */
  async mirror(film) {
    const planes = film.page.getByRole("group", { name: "Mirror plane" });
    film.inspector = true;
    await film.choose(planes.getByRole("button", { name: "X", exact: true }));
    await film.until((s) => s.edit.symmetry !== null);
    await film.hold([0.29, 0.3, 0.1]);
    await film.drag([33, 9], [44, 12]);
  },
};

/** Each film's shape, from where it is seen (pixels of a drag), and how near. */
const FILMS = {
  point: ["quadruped", [0, 0], 3],
  pull: ["chair", [0, 0], -4],
  bend: ["quadruped", [330, 0], 3],
  fix: ["quadruped", [0, 0], 1],
  mirror: ["robot", [0, 0], 1],
  limit: ["quadruped", [0, 0], 1],
};

const browser = await launch();
for (const name of DFD_FILMS.split(" ")) {
  const { context, page } = await openTab(browser, { viewport: { width: 1064, height: 560 }, colorScheme: "light" });
  const [shape, turned, steps] = FILMS[name];
  const stem = join(DFD_SHAPES, shape);
  await open(page, [`${stem}.glb`, `${stem}.field.safetensors`]);
  await alive(page);
  const film = new Film(page, name);
  await film.begin(turned, steps);
  await SCENES[name](film);
  await context.close();
}
await browser.close();
