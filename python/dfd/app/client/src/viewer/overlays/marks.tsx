/** Marks over the canvas: handles, fixed points, counterparts, suggestions and the vertex under the pointer. */

import { render } from "preact";

import { send } from "../../actions/connection";
import { hold, select, toggleCounterpart } from "../../actions/edit";
import { apply, matrixOf, subtract, type Vec3 } from "../../posing/affine";
import { posePoint, type Scene } from "../../posing/columns";
import { followed, LEAST_SEEN } from "../../posing/held";
import { handleColor, handleName, otherPlaces, placeName, present, stepText, type State } from "../../store/state";
import { columnsOf } from "../scene";
import type { Shape } from "../shape";
import type { Gizmo } from "./gizmo";

type Project = (point: Vec3) => readonly [number, number] | null;

interface Mark {
  readonly key: string;
  /** The classes of the mark in the style sheet. */
  readonly kind: string;
  readonly at: Vec3;
  /** The point from which a line leads to the mark. */
  readonly from?: Vec3;
  readonly label: string;
  /** Words that are shown beside the mark. */
  readonly said?: string;
  /** The color of the handle. */
  readonly color?: string;
  /** The diameter in pixels, unless it is that of the kind. */
  readonly size?: number;
  readonly press?: () => unknown;
}

/** Return the mark of the ring that scales evenly. */
export function ringMarks({ ring }: Gizmo): Mark[] {
  if (!ring) return [];
  const kind = ring.hot ? "ring hot" : "ring";
  return [{ key: "ring", kind, at: ring.at, label: "Scale evenly", size: 2 * ring.radius }];
}

/** Draw marks at the pixels that `project` returns. */
export function drawMarks(layer: HTMLElement, marks: readonly Mark[], project: Project): void {
  const drawn = marks.map(({ key, kind, at, from, label, said, color, size, press }) => {
    const [x, y] = project(at) ?? [null, null];
    const [dx, dy] = (from && project(from)?.map((part, i) => part - ([x, y][i] ?? part))) ?? [0, 0];
    const style = {
      "--own": color,
      ...(from && { "--length": `${Math.hypot(dx, dy)}px`, "--angle": `${Math.atan2(dy, dx)}rad` }),
      ...(size && { "--size": `${size}px` }),
      ...(x === null ? { visibility: "hidden" } : { transform: `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)` }),
    };
    const words = [from && <i class="line" />, said && <span class="said">{said}</span>];
    const shown = { key, class: `mark ${kind}`, title: label, "aria-label": label, style, children: words };
    return press ? <button type="button" onClick={press} {...shown} /> : <div {...shown} />;
  });
  render(drawn, layer);
}

export function marksOf(state: State, scene: Scene, shape: Shape): Mark[] {
  const { edit, mesh } = state;
  if (!edit || !mesh) return [];
  const { center } = mesh;
  // If the server computes the pose, its positions include bends, which columns do not.
  const onSurface = (vertex: number, rest: Vec3): Vec3 =>
    state.posed ? vertexAt(state.posed.positions, vertex) : posePoint(scene, rest, vertex);
  const posed = (vertex: number | null, position: Vec3): Vec3 => {
    const at = subtract(position, center);
    return vertex === null ? at : onSurface(vertex, at);
  };
  const marks: Mark[] = [];
  edit.fixed.forEach((fixed, index) => {
    marks.push({
      key: `fixed ${index}`,
      kind: "fixed",
      at: posed(fixed.vertex, fixed.position),
      label: `Fixed ${placeName(fixed)}: press to release`,
      press: () => send({ type: "release", index }),
    });
  });
  for (const known of edit.handles) {
    const handle = present(state, known);
    const selected = state.selected === handle.handle;
    if (selected) marks.push(...counterpartMarks(state, posed));
    const at =
      handle.vertex === null
        ? subtract(apply(matrixOf(handle.transform, handle.position), handle.position), center)
        : posed(handle.vertex, handle.position);
    marks.push({
      key: `handle ${handle.handle}`,
      kind: selected ? "handle selected" : "handle",
      at,
      label: handleName(handle),
      color: handleColor(handle.handle),
      press: () => select(handle.handle),
    });
  }
  for (const { vertex, position, name } of state.suggestions) {
    const label = `Add a handle at ${name}`;
    const at = posed(vertex, position);
    marks.push({ key: `suggestion ${vertex}`, kind: "suggestion", at, label, press: () => hold(vertex) });
  }
  if (state.tool === "marks")
    edit.marks.forEach(({ vertex, position, target }, i) => {
      const goal = (state.marked?.index === i ? state.marked.target : target) ?? position;
      const label = `Mark ${i + 1}`;
      marks.push({
        key: `mark ${vertex}`,
        kind: "goal",
        at: subtract(goal, center),
        from: posed(vertex, position),
        label,
        said: label,
      });
    });
  const { hover } = state;
  if (hover && !state.dragging && state.tool !== "pivot") {
    const at = onSurface(hover.vertex, shape.at(hover.row));
    const said = state.probe?.vertex === hover.vertex ? stepText(state, hover.vertex, state.level) : "";
    marks.push({ key: "hover", kind: "hover", at, label: `Vertex ${hover.vertex}`, said });
  }
  return marks;
}

function vertexAt(positions: Float32Array, vertex: number): Vec3 {
  return [positions[3 * vertex], positions[3 * vertex + 1], positions[3 * vertex + 2]];
}

/** Return marks for the counterparts of the selected handle. A press switches the counterpart on or off. */
function counterpartMarks(state: State, posed: (vertex: number | null, position: Vec3) => Vec3): Mark[] {
  const { selected } = state;
  if (selected === null) return [];
  const columns = columnsOf(state, selected);
  return otherPlaces(state).map(({ vertex, position, on }, i) => ({
    key: `counterpart ${selected} ${vertex}`,
    kind: on && followed(columns, vertex) >= LEAST_SEEN ? "counterpart" : "counterpart off",
    at: posed(vertex, position),
    label: `Counterpart ${i + 1}: press to ${on ? "leave it in place" : "move it too"}`,
    color: handleColor(selected),
    press: () => toggleCounterpart(selected, vertex),
  }));
}
