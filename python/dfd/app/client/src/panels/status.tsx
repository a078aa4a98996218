import { send } from "../actions/connection";
import { dismiss } from "../actions/toasts";
import { useParts } from "../store/use";
import { Button, IconButton, titled } from "../widgets/controls";
import { nextStep } from "./next_step";

export function StatusLine() {
  const state = useParts();
  const { link, dragging, report, ahead } = state;
  const said = report && !dragging ? report.text : "";
  return (
    <footer class="status">
      <span class={`link ${link}`} role="status">
        {link === "open" ? (ahead.size > 0 ? "Saving…" : "Saved") : link === "lost" ? "Reconnecting…" : titled(link)}
      </span>
      <span class="hint" role="status">
        {nextStep(state)}
      </span>
      <span class="report" role="status" title={said}>
        {said}
      </span>
    </footer>
  );
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
