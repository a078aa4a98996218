import { send } from "../actions/connection";
import { dismiss } from "../actions/toasts";
import { present, ready, selectedHandle, type State } from "../store/state";
import { useParts } from "../store/use";
import { held } from "../viewer/scene";
import { Button, IconButton, percent, titled } from "../widgets/controls";

const HINTS = {
  hold: "Click a point to add a handle · drag to orbit",
  fix: "Click a point to fix it · click it again to release it",
  paint: "Paint the shape · Shift erases · right button orbits",
  box: "Draw a box over the shape · Shift erases · right button orbits",
  pivot: "Drag the gizmo to move the pivot of the selected handle",
} as const;

export function StatusLine() {
  const state = useParts();
  const { link, tool, dragging, report, edit, ahead, comparing } = state;
  const { gizmo, selected, axis } = state;
  const said = report && !dragging ? report.text : "";
  const bends = gizmo === "bend" && tool === "hold" && selected !== null && axis?.handle === selected;
  const usual = bends ? (axis.tip ? "Drag the tip to bend the held part" : "The held part cannot bend") : HINTS[tool];
  const hint = dragging
    ? dragText(state)
    : comparing
      ? "The original shape"
      : ready({ edit })
        ? usual
        : "Drag to orbit";
  return (
    <footer class="status">
      <span class={`link ${link}`} role="status">
        {link === "open" ? (ahead.size > 0 ? "Saving…" : "Saved") : link === "lost" ? "Reconnecting…" : titled(link)}
      </span>
      <span class="hint">{hint}</span>
      <span class="report" role="status" title={said}>
        {said}
      </span>
    </footer>
  );
}

/** Return a text about the reach of the dragged handle. The wheel changes the reach. */
function dragText(state: State): string {
  const known = selectedHandle(state);
  if (!known) return "";
  const { reach, handle } = present(state, known);
  return `Wheel: reach ${reach.toFixed(2)} · moves ${percent(held(state, handle))} of the surface`;
}

export function Toasts() {
  const { toasts } = useParts();
  return (
    <div class="toasts" aria-live="polite">
      {toasts.map((toast) => (
        <div key={toast.key} class={`toast ${toast.kind}`} role={toast.kind === "problem" ? "alert" : "status"}>
          <p>{toast.text}</p>
          <IconButton icon="remove" label="Dismiss" onPress={() => dismiss(toast.key)} />
        </div>
      ))}
    </div>
  );
}

const TITLES = {
  open: "Opening",
  distill: "Learning features",
  prepare: "Preparing",
};

/** The progress of background work, or a button that starts to learn features. */
export function ProgressCard() {
  const { progress, edit, mesh } = useParts();
  if (progress) {
    const part = progress.total ? Math.min(progress.done / progress.total, 1) : null;
    const title = TITLES[progress.task];
    return (
      <section class="card progress" aria-label="Progress">
        <div class="card-line">
          <strong>{title}</strong>
          <span>{remaining(progress.seconds_left)}</span>
        </div>
        <progress aria-label={title} {...(part === null ? {} : { value: part })} max={1} />
        <div class="card-line">
          <small>{titled(progress.stage)}</small>
          {progress.task === "distill" && (
            <Button text="Cancel" style="small" onPress={() => send({ type: "cancel" })} />
          )}
        </div>
      </section>
    );
  }
  if (!mesh || edit?.field.status !== "none") return null;
  return (
    <section class="card" aria-label="Features">
      <div class="card-line">
        <span>This shape's features are not learned yet.</span>
        <Button text="Learn features" style="primary small" onPress={() => send({ type: "distill" })} />
      </div>
    </section>
  );
}

function remaining(seconds: number | null): string {
  if (seconds === null) return "";
  if (seconds < 60) return `${Math.max(Math.ceil(seconds), 1)} s left`;
  return `${Math.ceil(seconds / 60)} min left`;
}

/** A message that the session has ended, and why. */
export function Ended() {
  const { ended } = useParts();
  if (ended === null) return null;
  return (
    <div class="veil" role="alertdialog" aria-label="The session has ended">
      <div class="dialog">
        <h2>The session has ended</h2>
        <p>{ended}</p>
        <Button text="Reload" style="primary" onPress={() => location.reload()} />
      </div>
    </div>
  );
}
