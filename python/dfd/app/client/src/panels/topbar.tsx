import * as edit from "../actions/edit";
import { chooseFiles, closeMesh, copyScript, exportAs } from "../actions/files";
import { heatPicture, screenshot, turntable } from "../actions/pictures";
import { alive, store, type Look, type Theme } from "../store/state";
import { useStore } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { IconButton, Menu, Segmented } from "../widgets/controls";
import type { IconName } from "../widgets/icons";

const LOOKS: readonly (readonly [Look, string])[] = [
  ["texture", "Texture"],
  ["clay", "Clay"],
  ["features", "Features"],
  ["heat", "Heat map"],
];
const THEMES: Record<Theme, { readonly icon: IconName; readonly next: Theme; readonly label: string }> = {
  system: { icon: "system", next: "light", label: "Theme of the system" },
  light: { icon: "sun", next: "dark", label: "Light theme" },
  dark: { icon: "moon", next: "system", label: "Dark theme" },
};

export function Topbar({ viewer }: { readonly viewer: Viewer }) {
  const known = useStore(store, (state) => state.edit);
  const mesh = useStore(store, (state) => state.mesh);
  const look = useStore(store, (state) => state.look);
  const wireframe = useStore(store, (state) => state.wireframe);
  const quality = useStore(store, (state) => state.quality);
  const theme = THEMES[useStore(store, (state) => state.theme)];
  const inspector = useStore(store, (state) => state.inspector);
  const ready = useStore(store, alive);
  const moves = (known?.poses.length ?? 0) > 1;
  const { stage } = viewer;
  return (
    <header class="topbar">
      <div class="bar-group">
        <Menu
          icon="open"
          label="File"
          groups={[
            [
              { text: "Open a mesh or session…", hint: "Ctrl O", run: chooseFiles },
              { text: "Close", run: closeMesh },
            ],
            [
              { text: "Save session", hint: "JSON", run: () => void exportAs("edit") },
              { text: "Save field", hint: "safetensors", disabled: !ready, run: () => void exportAs("field") },
            ],
          ]}
        />
        <h1 class="name" title={mesh?.name}>
          {mesh?.name ?? "dfd"}
        </h1>
      </div>
      <div class="bar-group">
        <IconButton icon="undo" label="Undo" keys="Ctrl Z" disabled={!known?.can_undo} onPress={edit.undo} />
        <IconButton icon="redo" label="Redo" keys="Ctrl Shift Z" disabled={!known?.can_redo} onPress={edit.redo} />
      </div>
      <div class="bar-group middle">
        <Segmented label="Look" value={look} options={LOOKS} onChange={(value) => store.set({ look: value })} />
        <IconButton
          icon="wire"
          label="Wireframe"
          keys="Z"
          pressed={wireframe}
          onPress={() => store.set({ wireframe: !wireframe })}
        />
        <IconButton
          icon="quality"
          label={quality === "full" ? "Full quality while moving" : "Coarser while moving, where that is slow"}
          keys="Q"
          pressed={quality === "full"}
          onPress={() => store.set({ quality: quality === "full" ? "auto" : "full" })}
        />
      </div>
      <div class="bar-group end">
        <Menu
          icon="camera"
          label="Pictures"
          groups={[
            [
              { text: "Screenshot", hint: "PNG", run: () => void screenshot(stage, viewer.helpers) },
              { text: "Heat map of the handle", hint: "PNG", run: () => void heatPicture(stage, viewer.helpers) },
              { text: "Turntable", hint: "film", run: () => void turntable(stage, viewer.helpers) },
            ],
          ]}
        />
        <Menu
          icon="save"
          label="Export"
          text="Export"
          groups={[
            [
              { text: "GLB", hint: "materials, skins", run: () => void exportAs("glb") },
              { text: "OBJ", hint: "materials", run: () => void exportAs("obj") },
              { text: "PLY", run: () => void exportAs("ply") },
              { text: "STL", hint: "shape alone", run: () => void exportAs("stl") },
            ],
            [
              {
                text: "Animated GLB",
                hint: moves ? "key poses" : "needs two poses",
                disabled: !moves,
                run: () => void exportAs("animation"),
              },
            ],
            [
              { text: "Copy as Python", run: () => void copyScript("python") },
              { text: "Copy as command", run: () => void copyScript("command") },
            ],
          ]}
        />
        <IconButton icon={theme.icon} label={theme.label} onPress={() => store.set({ theme: theme.next })} />
        <IconButton icon="help" label="Keys" keys="?" onPress={() => store.set({ help: true })} />
        <IconButton
          icon="inspector"
          label="Inspector"
          keys="I"
          pressed={inspector}
          onPress={() => store.set({ inspector: !inspector })}
        />
      </div>
    </header>
  );
}
