/** What tests look at, on pages opened with `?test` alone. */

import { ask, drop } from "./actions/connection";
import { posePoint } from "./posing/columns";
import { store } from "./store/state";
import { sceneOf } from "./viewer/scene";
import type { Viewer } from "./viewer/viewer";

export function exposeForTests(viewer: Viewer): void {
  if (!new URLSearchParams(location.search).has("test")) return;
  const { stage } = viewer;
  const shown = () => {
    if (!viewer.shape) throw new Error("There is no shape yet.");
    return viewer.shape;
  };
  const hook = {
    store,
    /** (R, 4) posed positions relative to the mesh's center, and heat, as the shader has them. */
    positions(): Float32Array {
      const found = shown().read();
      const error = stage.renderer.getContext().getError();
      if (error !== 0) throw new Error(`The graphics refused something: ${error}`);
      return found;
    },
    /** (V, 3) positions at rest, relative to the mesh's center. */
    rest(): Float32Array {
      const { vertexOf, positions, message } = shown();
      const rest = new Float32Array(3 * message.vertices);
      vertexOf.forEach((vertex, row) => rest.set(positions.subarray(3 * row, 3 * row + 3), 3 * vertex));
      return rest;
    },
    /** (V, 3) positions relative to the mesh's center, as the server's kernel has them. */
    async computed(): Promise<Float32Array> {
      const received = await ask({ type: "compute" });
      if (!received) throw new Error("The server computed nothing.");
      return received.payload.get("positions", "float32");
    },
    /** (R) the vertex of each row. */
    vertices: () => shown().vertexOf,
    /** The vertex under a pixel of the view. */
    pick: (x: number, y: number) => viewer.pick(x, y)?.vertex ?? null,
    /** Where a vertex appears, in pixels of the page. */
    project(vertex: number): readonly [number, number] | null {
      const row = shown().vertexOf.indexOf(vertex);
      const at = stage.project(posePoint(sceneOf(store.get()), shown().at(row), vertex).position);
      const box = stage.canvas.getBoundingClientRect();
      return at && [at[0] + box.left, at[1] + box.top];
    },
    camera: () => stage.camera.position.toArray(),
    /** Lose the connection to the server, as a network does. */
    drop,
    /** Draw now, so that the canvas can be read in the same task; without the shape where `bare`. */
    draw(bare = false): void {
      const { group } = shown();
      group.visible = !bare;
      stage.draw();
      group.visible = true;
    },
    /** Draw now what the next frame would be. */
    drawNext: () => stage.drawNext(),
    /** Have the page believe that the whole takes so long to draw. */
    pretend(milliseconds: number): void {
      const { pace } = stage;
      const measured = pace.measured.bind(pace);
      pace.measured = () => measured(milliseconds);
      // One alone would not be believed.
      for (let i = 0; i < 2; i++) pace.measured(milliseconds);
    },
    /** Whether nothing is left to be drawn. */
    rests: () => stage.rests,
    /** Triangles of the newest picture, with those of the gizmo and what else is drawn. */
    triangles: () => stage.renderer.info.render.triangles,
    /** Pictures drawn a second, over that many, when each asks for the next. */
    framesPerSecond: (seconds: number) =>
      new Promise<number>((resolve) => {
        const { drawn } = stage;
        const begun = performance.now();
        let count = 0;
        stage.drawn = () => {
          drawn();
          count++;
          const gone = (performance.now() - begun) / 1000;
          if (gone >= seconds) {
            stage.drawn = drawn;
            resolve(count / gone);
          } else stage.invalidate();
        };
        stage.invalidate();
      }),
  };
  Object.assign(window, { dfd: hook });
}
