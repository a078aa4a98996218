/** The toolbar at the left, and the bar at the top. On a phone, one menu has the entries of both. */

import { ACTIONS, LOOKS, type Action, type ActionName } from "../actions/actions";
import { send } from "../actions/connection";
import { chooseFiles, exportAs } from "../actions/files";
import type { Export } from "../protocol/messages";
import { MODES, ready, store, TOOLS } from "../store/state";
import { useParts } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { ActionButton, handleCount, Menu, Segmented, titled, type MenuItem } from "../widgets/controls";

export function Toolbar() {
  const { edit, tool, gizmo, snap, local, xray, isolated, weights, comparing, suggestions } = useParts();
  const disabled = !ready({ edit });
  return (
    <nav class="toolbar" aria-label="Tools">
      <div role="group" aria-label="What a click does">
        {TOOLS.map((name) => (
          <ActionButton key={name} action={name} pressed={tool === name} disabled={disabled} />
        ))}
      </div>
      <div role="group" aria-label="Gizmo">
        {MODES.map((name) => (
          <ActionButton key={name} action={name} pressed={gizmo === name} disabled={disabled} />
        ))}
        <ActionButton action="snap" pressed={snap} disabled={disabled} />
        <ActionButton action="local" pressed={local} disabled={disabled} />
      </div>
      <div role="group" aria-label="Shape">
        <ActionButton action="xray" pressed={xray} />
        <ActionButton action="isolate" pressed={isolated} disabled={disabled} />
        <ActionButton action="weights" pressed={weights} disabled={disabled} />
        <ActionButton action="suggest" pressed={suggestions.length > 0} disabled={disabled} />
        <ActionButton action="compare" pressed={comparing} disabled={disabled} />
      </div>
    </nav>
  );
}

const VIEWS = [
  ["frame", "frameShape", "orthographic"],
  ["front", "right", "top"],
  ["back", "left", "bottom"],
] as const;

export function Topbar({ viewer }: { readonly viewer: Viewer }) {
  const { edit, mesh, recent, look, wireframe, inspector, timeline, narrow, gizmo } = useParts();
  const known = ready({ edit });
  const handles = (edit?.handles.length ?? 0) > 0;
  const poses = (edit?.poses.length ?? 0) > 1;
  const done = edit?.step ?? 0;
  const file = (text: string, hint: string, format: Export["format"], possible = true): MenuItem => [
    text,
    hint,
    possible ? () => exportAs(format) : null,
  ];
  const actions = (names: readonly ActionName[]) =>
    names.map((name): MenuItem => {
      const { label, keys, run }: Action = ACTIONS[name];
      return [label, narrow ? "" : keys, run];
    });
  const opens: MenuItem[] = [
    ["Open a mesh or session…", narrow ? "" : "Ctrl O", chooseFiles],
    ["Start fresh", "keeps this edit", known ? () => send({ type: "start_fresh" }) : null],
    ["Close", "", () => send({ type: "close_mesh" })],
  ];
  const earlier = recent.map(({ key, name, handles, present }): MenuItem => {
    const hint = present ? handleCount(handles) : "the file is gone";
    return [titled(name), hint, present ? () => send({ type: "open_recent", key }) : null];
  });
  const saves = [file("Save session", "JSON", "edit"), file("Save field", "safetensors", "field", known)];
  const shapes = [
    file("GLB", "materials, skins", "glb"),
    file("OBJ", "materials", "obj"),
    file("PLY", "", "ply"),
    file("STL", "shape only", "stl"),
  ];
  const rigs = [
    file("Rig", "GLB, joints", "rig", handles),
    file("Morph targets", "GLB", "morph", handles),
    file("Animated GLB", poses ? "key poses" : "needs two poses", "animation", poses),
    file("Weights", "NPZ", "weights", handles),
  ];
  const steps = ["Beginning", ...(edit?.steps ?? [])].map((name, step): MenuItem => {
    const by = step - done;
    return [name, by === 0 ? "now" : "", by === 0 ? null : () => send({ type: "go", by })];
  });
  const [undoable, redoable] = [done > 0, done < steps.length - 1];
  steps.reverse();
  const pictures: MenuItem[] = [
    ["Save a picture", "PNG", () => viewer.screenshot()],
    ["Without background", "PNG", () => viewer.screenshot(true)],
  ];
  const undo = <ActionButton action="undo" disabled={!undoable} />;
  const redo = <ActionButton action="redo" disabled={!redoable} />;
  const inspect = <ActionButton action="inspector" pressed={inspector} />;
  const name = <h1 class="name" title={mesh?.name} children={mesh?.name ?? "dfd"} />;
  if (narrow)
    return (
      <header class="topbar">
        <Menu
          icon="menu"
          label="Menu"
          groups={[
            ["File", [...opens, ...saves]],
            ["Continue an edit", earlier],
            ["What a tap does", actions(TOOLS)],
            ["Gizmo", actions(["snap", "local"])],
            ["Shape", actions(["suggest", "compare", "weights", "xray", "isolate", "timeline", "help"])],
            ["Export", [...shapes, ...rigs]],
            ["Picture", pictures],
            ["Look", LOOKS.map((each) => [titled(each), each === look ? "now" : "", () => store.set({ look: each })])],
            ["View", VIEWS.flatMap(actions)],
            ["Steps", steps],
          ]}
        />
        {name}
        {undo}
        {redo}
        <Menu icon={gizmo} label="Motion" groups={[["", actions(MODES)]]} />
        {inspect}
      </header>
    );
  return (
    <header class="topbar">
      <div class="bar-group">
        <Menu icon="open" label="File" groups={[["", opens] as const, ["Continue", earlier] as const, ["", saves]]} />
        {name}
      </div>
      <div class="bar-group">
        {undo}
        {redo}
        <Menu icon="steps" label="Steps" groups={[["", steps]]} />
      </div>
      <div class="bar-group middle">
        <Segmented label="Look" value={look} options={LOOKS} onChange={(value) => store.set({ look: value })} />
        <Menu icon="views" label="Views" groups={VIEWS.map((names) => ["", actions(names)])} />
        <ActionButton action="wire" pressed={wireframe} />
      </div>
      <div class="bar-group">
        <Menu icon="camera" label="Picture" groups={[["", pictures]]} />
        <Menu
          icon="save"
          label="Export"
          text="Export"
          groups={[["The shape", shapes] as const, ["To animate", rigs]]}
        />
        <ActionButton action="timeline" pressed={timeline} />
        <ActionButton action="help" />
        {inspect}
      </div>
    </header>
  );
}
