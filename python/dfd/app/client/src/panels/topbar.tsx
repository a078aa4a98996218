import { send } from "../actions/connection";
import { chooseFiles, exportAs } from "../actions/files";
import { ACTIONS, LOOKS, type Action, type ActionName } from "../actions/actions";
import type { Export } from "../protocol/messages";
import { MODES, ready, store, TOOLS } from "../store/state";
import { useParts } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { handleCount, ActionButton, Menu, Segmented, titled, type MenuGroup, type MenuItem } from "../widgets/controls";

const exported = (text: string, hint: string, format: Export["format"], possible = true): MenuItem => [
  text,
  hint,
  possible ? () => void exportAs(format) : null,
];

/** Return menu items for actions. They show the keys, unless the page is on a phone. */
function actionItems(names: readonly ActionName[], keyed = true): readonly MenuItem[] {
  return names.map((name) => {
    const { label, keys, run }: Action = ACTIONS[name];
    return [label, keyed ? keys : "", () => void run()];
  });
}

const VIEWS = [
  ["frame", "frameShape", "orthographic"],
  ["front", "right", "top"],
  ["back", "left", "bottom"],
] as const;

export function Topbar({ viewer }: { readonly viewer: Viewer }) {
  const { edit, mesh, recent, look, wireframe, inspector, timeline, narrow, gizmo } = useParts();
  const moves = (edit?.poses.length ?? 0) > 1;
  const open: MenuItem[] = [
    ["Open a mesh or session…", narrow ? "" : "Ctrl O", chooseFiles],
    ["Start fresh", "keeps this edit", ready({ edit }) ? () => send({ type: "start_fresh" }) : null],
    ["Close", "", () => send({ type: "close_mesh" })],
  ];
  const earlier = recent.map(({ key, name, handles, present }): MenuItem => {
    const hint = present ? handleCount(handles) : "the file is gone";
    return [titled(name), hint, present ? () => send({ type: "open_recent", key }) : null];
  });
  const saved = [
    exported("Save session", "JSON", "edit"),
    exported("Save field", "safetensors", "field", ready({ edit })),
  ];
  const shapes = [
    exported("GLB", "materials, skins", "glb"),
    exported("OBJ", "materials", "obj"),
    exported("PLY", "", "ply"),
    exported("STL", "shape only", "stl"),
  ];
  const held = (edit?.handles.length ?? 0) > 0;
  const rigs = [
    exported("Rig", "GLB, joints", "rig", held),
    exported("Morph targets", "GLB", "morph", held),
    exported("Animated GLB", moves ? "key poses" : "needs two poses", "animation", moves),
    exported("Weights", "NPZ", "weights", held),
  ];
  const steps = ["Beginning", ...(edit?.steps ?? [])];
  const done = edit?.step ?? 0;
  const history = steps.map((name, i): MenuItem => {
    return [name, i === done ? "now" : "", i === done ? null : () => send({ type: "go", step: i })];
  });
  history.reverse();
  const pictures: MenuItem[] = [
    ["Save a picture", "PNG", () => viewer.screenshot()],
    ["Without background", "PNG", () => viewer.screenshot(true)],
  ];
  const undo = <ActionButton action="undo" disabled={!edit?.can_undo} />;
  const redo = <ActionButton action="redo" disabled={!edit?.can_redo} />;
  const inspect = <ActionButton action="inspector" pressed={inspector} />;
  const name = (
    <h1 class="name" title={mesh?.name}>
      {mesh?.name ?? "dfd"}
    </h1>
  );
  if (narrow) {
    const looks = LOOKS.map((each): MenuItem => [
      titled(each),
      each === look ? "now" : "",
      () => store.set({ look: each }),
    ]);
    const short = (names: readonly ActionName[]) => actionItems(names, false);
    const groups: MenuGroup[] = [
      ["File", [...open, ...saved]],
      ["Continue an edit", earlier],
      ["What a tap does", short(TOOLS)],
      ["Gizmo", short(["snap", "local"])],
      ["Shape", short(["suggest", "compare", "weights", "xray", "isolate", "timeline", "help"])],
      ["Export", [...shapes, ...rigs]],
      ["Picture", pictures],
      ["Look", looks],
      ["View", VIEWS.flatMap(short)],
      ["Steps", history],
    ];
    return (
      <header class="topbar">
        <Menu icon="menu" label="Menu" groups={groups} />
        {name}
        {undo}
        {redo}
        <Menu icon={gizmo} label="Motion" groups={[["", actionItems(MODES, false)]]} />
        {inspect}
      </header>
    );
  }
  return (
    <header class="topbar">
      <div class="bar-group">
        <Menu
          icon="open"
          label="File"
          groups={[
            ["", open],
            ["Continue", earlier],
            ["", saved],
          ]}
        />
        {name}
      </div>
      <div class="bar-group">
        {undo}
        {redo}
        <Menu icon="steps" label="Steps" groups={[["", history]]} />
      </div>
      <div class="bar-group middle">
        <Segmented label="Look" value={look} options={LOOKS} onChange={(value) => store.set({ look: value })} />
        <Menu icon="views" label="Views" groups={VIEWS.map((names) => ["", actionItems(names)] as const)} />
        <ActionButton action="wire" pressed={wireframe} />
      </div>
      <div class="bar-group end">
        <Menu icon="camera" label="Picture" groups={[["", pictures]]} />
        <Menu
          icon="save"
          label="Export"
          text="Export"
          groups={[
            ["The shape", shapes],
            ["To animate", rigs],
          ]}
        />
        <ActionButton action="timeline" pressed={timeline} />
        <ActionButton action="help" />
        {inspect}
      </div>
    </header>
  );
}
