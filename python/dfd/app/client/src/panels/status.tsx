import { cancel, distill } from "../actions/edit";
import { dismiss } from "../actions/toasts";
import { store } from "../store/state";
import { useStore } from "../store/use";
import { IconButton, titled } from "../widgets/controls";

const HINTS = {
  hold: "Click to take hold · drag to orbit",
  fix: "Click to fix a point, or again to release it",
  paint: "Paint over the shape · Shift erases · right button orbits",
  pivot: "Drag the gizmo to move the pivot of the selected handle",
} as const;

export function StatusLine() {
  const link = useStore(store, (state) => state.link);
  const tool = useStore(store, (state) => state.tool);
  const hover = useStore(store, (state) => state.hover);
  const dragging = useStore(store, (state) => state.dragging);
  const report = useStore(store, (state) => state.report);
  const known = useStore(store, (state) => state.edit);
  const timeline = useStore(store, (state) => state.timeline);
  const pending = useStore(store, (state) => state.ahead.size > 0);
  const comparing = useStore(store, (state) => state.comparing);
  const seen = useStore(store, (state) => state.seen);
  const said = report && !dragging ? report.text : "";
  const hint = dragging
    ? "Wheel changes reach"
    : comparing
      ? "The original"
      : known?.field.status === "ready"
        ? HINTS[tool]
        : "Drag to orbit";
  return (
    <footer class="status">
      <span class={`link ${link}`} role="status">
        {link === "open" ? (pending ? "Saving…" : "Saved") : link === "lost" ? "Reconnecting…" : titled(link)}
      </span>
      <span class="hint">{hint}</span>
      <span class="report" role="status" title={said}>
        {said}
      </span>
      {hover && <span class="where">vertex {hover.vertex}</span>}
      {seen !== "full" && (
        <span class="seen">{seen === "loading" ? "Coarse while it loads" : "Coarse while moving"}</span>
      )}
      <button
        type="button"
        class="status-button"
        aria-pressed={timeline}
        title="Timeline (T)"
        onClick={() => store.set({ timeline: !timeline })}
      >
        Timeline
      </button>
    </footer>
  );
}

export function Toasts() {
  const toasts = useStore(store, (state) => state.toasts);
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

/** What keeps the shape from being held yet, and how long that takes. */
export function ProgressCard() {
  const progress = useStore(store, (state) => state.progress);
  const status = useStore(store, (state) => state.edit?.field.status);
  const mesh = useStore(store, (state) => state.mesh);
  if (progress) {
    const part = progress.total ? Math.min(progress.done / progress.total, 1) : null;
    const title = {
      open: "Opening",
      distill: "Learning what looks alike",
      prepare: "Preparing",
      export: "Writing the file",
    };
    return (
      <section class="card progress" aria-label="Progress">
        <div class="card-line">
          <strong>{title[progress.task]}</strong>
          <span>{remaining(progress.seconds_left)}</span>
        </div>
        <progress aria-label={title[progress.task]} {...(part === null ? {} : { value: part })} max={1} />
        <div class="card-line">
          <small>{titled(progress.stage)}</small>
          {progress.task === "distill" && (
            <button type="button" class="button small" onClick={cancel}>
              Cancel
            </button>
          )}
        </div>
      </section>
    );
  }
  if (!mesh || status !== "none") return null;
  return (
    <section class="card" aria-label="Features">
      <div class="card-line">
        <span>This shape's features are not learned yet.</span>
        <button type="button" class="button primary small" onClick={distill}>
          Learn features
        </button>
      </div>
    </section>
  );
}

function remaining(seconds: number | null): string {
  if (seconds === null) return "";
  if (seconds < 60) return `${Math.max(Math.ceil(seconds), 1)} s left`;
  return `${Math.ceil(seconds / 60)} min left`;
}

/** The last thing said where nothing more can be done here. */
export function Ended() {
  const ended = useStore(store, (state) => state.ended);
  if (ended === null) return null;
  return (
    <div class="veil" role="alertdialog" aria-label="The session has ended">
      <div class="dialog">
        <h2>That is all here</h2>
        <p>{ended}</p>
        <button type="button" class="button primary" onClick={() => location.reload()}>
          Reload
        </button>
      </div>
    </div>
  );
}
