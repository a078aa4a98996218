import { send } from "../actions/connection";
import { chooseFiles, exportAs } from "../actions/files";
import { LOOKS, SHORTCUTS } from "../actions/keyboard";
import type { Export } from "../protocol/messages";
import { ready, store } from "../store/state";
import { useParts } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { IconButton, KeyButton, Menu, Segmented, type MenuItem } from "../widgets/controls";

const exported = (text: string, hint: string, format: Export["format"], possible = true): MenuItem => [
  text,
  hint,
  possible ? () => void exportAs(format) : null,
];

const VIEWS: readonly (readonly MenuItem[])[] = [
  ["F", "Shift F"],
  ["Num 1", "Num 3", "Num 7"],
  ["Ctrl Num 1", "Ctrl Num 3", "Ctrl Num 7"],
].map((group) =>
  SHORTCUTS.filter(([keys]) => group.includes(keys)).map(([keys, , label, run]) => [label, keys, () => void run()]),
);

export function Topbar({ viewer }: { readonly viewer: Viewer }) {
  const { edit, mesh, look, wireframe, inspector, timeline } = useParts();
  const moves = (edit?.poses.length ?? 0) > 1;
  const open: MenuItem[] = [
    ["Open a mesh or session…", "Ctrl O", chooseFiles],
    ["Close", "", () => send({ type: "close_mesh" })],
  ];
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
  return (
    <header class="topbar">
      <div class="bar-group">
        <Menu icon="open" label="File" groups={[open, saved]} />
        <h1 class="name" title={mesh?.name}>
          {mesh?.name ?? "dfd"}
        </h1>
      </div>
      <div class="bar-group">
        <KeyButton icon="undo" keys="Ctrl Z" disabled={!edit?.can_undo} />
        <KeyButton icon="redo" keys="Ctrl Shift Z" disabled={!edit?.can_redo} />
      </div>
      <div class="bar-group middle">
        <Segmented label="Look" value={look} options={LOOKS} onChange={(value) => store.set({ look: value })} />
        <Menu icon="views" label="Views" groups={VIEWS} />
        <KeyButton icon="wire" keys="Z" pressed={wireframe} />
      </div>
      <div class="bar-group end">
        <IconButton icon="camera" label="Screenshot" onPress={() => viewer.screenshot()} />
        <Menu icon="save" label="Export" text="Export" groups={[shapes, rigs]} />
        <KeyButton icon="play" keys="T" pressed={timeline} />
        <KeyButton icon="help" keys="?" />
        <KeyButton icon="inspector" keys="I" pressed={inspector} />
      </div>
    </header>
  );
}
