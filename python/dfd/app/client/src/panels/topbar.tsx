import { send } from "../actions/connection";
import { chooseFiles, copyScript, exportAs } from "../actions/files";
import { redo, toggle, toggleQuality, undo } from "../actions/keyboard";
import { ready, store, type Look, type Theme } from "../store/state";
import { useStore } from "../store/use";
import { heatPicture, screenshot, turntable } from "../viewer/pictures";
import type { Viewer } from "../viewer/viewer";
import { IconButton, Menu, Segmented } from "../widgets/controls";
import type { IconName } from "../widgets/icons";

const LOOKS: Record<Look, string> = { texture: "Texture", clay: "Clay", features: "Features", heat: "Heat map" };
const THEMES: Record<Theme, readonly [icon: IconName, next: Theme, label: string]> = {
  system: ["system", "light", "Theme of the system"],
  light: ["sun", "dark", "Light theme"],
  dark: ["moon", "system", "Dark theme"],
};

export function Topbar({ viewer }: { readonly viewer: Viewer }) {
  const [known, mesh, look, wireframe, quality, chosen, inspector, alive] = useStore(
    (s) => [s.edit, s.mesh, s.look, s.wireframe, s.quality, s.theme, s.inspector, ready(s)] as const,
  );
  const [themeIcon, nextTheme, themeLabel] = THEMES[chosen];
  const moves = (known?.poses.length ?? 0) > 1;
  const full = quality === "full";
  return (
    <header class="topbar">
      <div class="bar-group">
        <Menu
          icon="open"
          label="File"
          groups={[
            [
              ["Open a mesh or session…", "Ctrl O", chooseFiles],
              ["Close", "", () => send({ type: "close_mesh" })],
            ],
            [
              ["Save session", "JSON", () => void exportAs("edit")],
              ["Save field", "safetensors", alive ? () => void exportAs("field") : null],
            ],
          ]}
        />
        <h1 class="name" title={mesh?.name}>
          {mesh?.name ?? "dfd"}
        </h1>
      </div>
      <div class="bar-group">
        <IconButton icon="undo" label="Undo" keys="Ctrl Z" disabled={!known?.can_undo} onPress={undo} />
        <IconButton icon="redo" label="Redo" keys="Ctrl Shift Z" disabled={!known?.can_redo} onPress={redo} />
      </div>
      <div class="bar-group middle">
        <Segmented label="Look" value={look} options={LOOKS} onChange={(value) => store.set({ look: value })} />
        <IconButton icon="wire" label="Wireframe" keys="Z" pressed={wireframe} onPress={() => toggle("wireframe")} />
        <IconButton
          icon="quality"
          label={full ? "Full quality while moving" : "Coarser while moving, where that is slow"}
          keys="Q"
          pressed={full}
          onPress={toggleQuality}
        />
      </div>
      <div class="bar-group end">
        <Menu
          icon="camera"
          label="Pictures"
          groups={[
            [
              ["Screenshot", "PNG", () => void screenshot(viewer)],
              ["Heat map of the handle", "PNG", () => void heatPicture(viewer)],
              ["Turntable", "film", () => void turntable(viewer)],
            ],
          ]}
        />
        <Menu
          icon="save"
          label="Export"
          text="Export"
          groups={[
            [
              ["GLB", "materials, skins", () => void exportAs("glb")],
              ["OBJ", "materials", () => void exportAs("obj")],
              ["PLY", "", () => void exportAs("ply")],
              ["STL", "shape alone", () => void exportAs("stl")],
            ],
            [
              [
                "Animated GLB",
                moves ? "key poses" : "needs two poses",
                moves ? () => void exportAs("animation") : null,
              ],
            ],
            [
              ["Copy as Python", "", () => void copyScript("python")],
              ["Copy as command", "", () => void copyScript("command")],
            ],
          ]}
        />
        <IconButton icon={themeIcon} label={themeLabel} onPress={() => store.set({ theme: nextTheme })} />
        <IconButton icon="help" label="Keys" keys="?" onPress={() => toggle("help")} />
        <IconButton
          icon="inspector"
          label="Inspector"
          keys="I"
          pressed={inspector}
          onPress={() => toggle("inspector")}
        />
      </div>
    </header>
  );
}
