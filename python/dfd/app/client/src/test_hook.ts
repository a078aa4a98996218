/** What tests look at, on pages opened with `?test` alone. */

import { ask, drop } from "./actions/server";
import { store } from "./store/state";
import { posePoint } from "./viewer/posing/twin";
import { sceneOf } from "./viewer/scene";
import type { Viewer } from "./viewer/viewer";

export interface TestHook {
  readonly store: typeof store;
  /** (R, 4) posed positions relative to the mesh's center, and heat, as the shader has them. */
  positions(): Float32Array;
  /** The same of one row by the shader's twin. */
  twin(row: number): { position: readonly number[]; heat: number };
  /** (V, 3) positions at rest, relative to the mesh's center. */
  rest(): Float32Array;
  /** (V, 3) positions relative to the mesh's center, as the server's kernel has them. */
  computed(): Promise<Float32Array>;
  /** (R) the vertex of each row. */
  vertices(): Uint32Array;
  /** The vertex under a pixel of the view. */
  pick(x: number, y: number): number | null;
  /** Where a vertex appears, in pixels of the page. */
  project(vertex: number): readonly [number, number] | null;
  /** Where the camera is. */
  camera(): readonly number[];
  /** Lose the connection to the server, as a network does. */
  drop(): void;
  /** Draw now, so that the canvas can be read in the same task; without the shape where `bare`. */
  draw(bare?: boolean): void;
  /** Draw now what the next frame would be. */
  drawNext(): void;
  /** Have the page believe that the whole takes so long to draw. */
  pretend(milliseconds: number): void;
  /** Whether nothing is left to be drawn. */
  rests(): boolean;
  /** Triangles of the newest picture, with those of the gizmo and what else is drawn. */
  triangles(): number;
  /** Pictures drawn a second, over that many, when each asks for the next. */
  framesPerSecond(seconds: number): Promise<number>;
}

declare global {
  interface Window {
    dfd?: TestHook;
  }
}

export function exposeForTests(viewer: Viewer): void {
  if (!new URLSearchParams(location.search).has("test")) return;
  const shape = () => {
    if (!viewer.shape) throw new Error("There is no shape yet.");
    return { shape: viewer.shape };
  };
  const rowOf = (vertex: number) => shape().shape.vertexOf.indexOf(vertex);
  const twin = (row: number) => posePoint(sceneOf(store.get()), shape().shape.at(row), shape().shape.vertexOf[row]);
  window.dfd = {
    store,
    twin,
    positions: () => {
      const found = shape().shape.read();
      const error = viewer.stage.renderer.getContext().getError();
      if (error !== 0) throw new Error(`The graphics refused something: ${error}`);
      return found;
    },
    rest: () => {
      const { vertexOf, positions, message } = shape().shape;
      const rest = new Float32Array(3 * message.vertices);
      vertexOf.forEach((vertex, row) => rest.set(positions.subarray(3 * row, 3 * row + 3), 3 * vertex));
      return rest;
    },
    computed: async () => {
      const received = await ask({ type: "compute" });
      if (!received?.payload) throw new Error("The server computed nothing.");
      return received.payload.get("positions", "float32");
    },
    vertices: () => shape().shape.vertexOf,
    pick: (x, y) => viewer.pick(x, y)?.vertex ?? null,
    project: (vertex) => {
      const at = viewer.stage.project(twin(rowOf(vertex)).position);
      const box = viewer.stage.canvas.getBoundingClientRect();
      return at && [at[0] + box.left, at[1] + box.top];
    },
    camera: () => viewer.stage.camera.position.toArray(),
    drop,
    draw: (bare) => {
      const { group } = shape().shape;
      group.visible = !bare;
      viewer.stage.draw();
      group.visible = true;
    },
    pretend: (milliseconds) => {
      const { pace } = viewer.stage;
      const measured = pace.measured.bind(pace);
      pace.measured = () => measured(milliseconds);
      // One alone would not be believed.
      for (let i = 0; i < 2; i++) pace.measured(milliseconds);
    },
    rests: () => viewer.stage.rests,
    triangles: () => viewer.stage.renderer.info.render.triangles,
    drawNext: () => viewer.stage.drawNext(),
    framesPerSecond: (seconds) =>
      new Promise((resolve) => {
        const { stage } = viewer;
        const { drawn } = stage;
        const begun = performance.now();
        let count = 0;
        stage.drawn = () => {
          drawn();
          count++;
          const gone = (performance.now() - begun) / 1000;
          if (gone < seconds) {
            stage.invalidate();
            return;
          }
          stage.drawn = drawn;
          resolve(count / gone);
        };
        stage.invalidate();
      }),
  };
}
