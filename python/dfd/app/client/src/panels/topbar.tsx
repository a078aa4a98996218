import { send } from "../actions/connection";
import { chooseFiles, exportAs } from "../actions/files";
import { LOOKS, SHORTCUTS } from "../actions/keyboard";
import type { Export } from "../protocol/messages";
import { ready, store } from "../store/state";
import { useParts } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { handleCount, IconButton, KeyButton, Menu, Segmented, titled, type MenuItem } from "../widgets/controls";

const exported = (text: string, hint: string, format: Export["format"], possible = true): MenuItem => [
  text,
  hint,
  possible ? () => void exportAs(format) : null,
];

/** Return menu items for the actions of keyboard shortcuts. They show the keys, unless the page is on a phone. */
function keyItems(group: readonly string[], shown = true): readonly MenuItem[] {
  return SHORTCUTS.filter(([keys]) => group.includes(keys)).map(([keys, , label, run]) => [
    label,
    shown ? keys : "",
    () => void run(),
  ]);
}

const VIEWS = [
  ["F", "Shift F", "5"],
  ["1", "3", "7"],
  ["Shift 1", "Shift 3", "Shift 7"],
];
const TOOLS = ["H", "X", "B", "M", "P"];
const MODES = ["W", "E", "R", "D"];

export function Topbar({ viewer }: { readonly viewer: Viewer }) {
  const { edit, mesh, recent, look, wireframe, inspector, timeline, narrow, gizmo } = useParts();
  const moves = (edit?.poses.length ?? 0) > 1;
  const open: MenuItem[] = [
    ["Open a mesh or session…", narrow ? "" : "Ctrl O", chooseFiles],
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
  const undo = <KeyButton icon="undo" keys="Ctrl Z" disabled={!edit?.can_undo} />;
  const redo = <KeyButton icon="redo" keys="Ctrl Shift Z" disabled={!edit?.can_redo} />;
  const inspect = <KeyButton icon="inspector" keys="I" pressed={inspector} />;
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
    const short = (keys: readonly string[]) => keyItems(keys, false);
    const groups = [
      [...open, ...saved],
      earlier,
      short(TOOLS),
      short(["A", "C", "T", "?"]),
      shapes,
      rigs,
      looks,
      ...VIEWS.map(short),
      history,
    ];
    return (
      <header class="topbar">
        <Menu icon="menu" label="Menu" groups={groups} />
        {name}
        {undo}
        {redo}
        <Menu icon={gizmo} label="Motion" groups={[keyItems(MODES, false)]} />
        {inspect}
      </header>
    );
  }
  return (
    <header class="topbar">
      <div class="bar-group">
        <Menu icon="open" label="File" groups={[open, earlier, saved]} />
        {name}
      </div>
      <div class="bar-group">
        {undo}
        {redo}
        <Menu icon="steps" label="Steps" groups={[history]} />
      </div>
      <div class="bar-group middle">
        <Segmented label="Look" value={look} options={LOOKS} onChange={(value) => store.set({ look: value })} />
        <Menu icon="views" label="Views" groups={VIEWS.map((keys) => keyItems(keys))} />
        <KeyButton icon="wire" keys="Z" pressed={wireframe} />
      </div>
      <div class="bar-group end">
        <IconButton icon="camera" label="Screenshot" onPress={() => viewer.screenshot()} />
        <Menu icon="save" label="Export" text="Export" groups={[shapes, rigs]} />
        <KeyButton icon="timeline" keys="T" pressed={timeline} />
        <KeyButton icon="help" keys="?" />
        {inspect}
      </div>
    </header>
  );
}
