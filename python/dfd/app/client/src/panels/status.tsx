import { connect, send } from "../actions/connection";
import { dismiss } from "../actions/toasts";
import { ready } from "../store/state";
import { useParts } from "../store/use";
import { Button, Dialog, IconButton } from "../widgets/controls";
import { nextStep } from "./next_step";

/** What the page says without a connection. */
const LINKS: Partial<Record<string, string>> = { lost: "Reconnecting…", connecting: "Connecting", closed: "Closed" };

export function StatusLine() {
  const state = useParts();
  const { link, dragging, report, ahead, saved, busy, drawn, progress } = state;
  const said = report && !dragging ? report.text : "";
  const opens = !drawn || !ready(state) || progress?.task === "open";
  const kept = saved && ahead.size === 0;
  return (
    <footer class="status">
      <span class={`link ${link}`} role="status">
        {LINKS[link] ?? (opens ? "Opening…" : busy ? "Working…" : kept ? "Saved" : "Saving…")}
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
          {toast.action && (
            <Button
              text={toast.action.text}
              kind="small"
              onClick={() => {
                toast.action?.run();
                dismiss(toast.key);
              }}
            />
          )}
          <IconButton icon="remove" label="Dismiss" onClick={() => dismiss(toast.key)} />
        </div>
      ))}
    </div>
  );
}

/** The progress of background work until parts can be held, or a button that starts to learn features. */
export function ProgressCard() {
  const { progress, edit, mesh, drawn } = useParts();
  if (progress || (mesh && !drawn)) {
    const { share = null, text = "Drawing the shape", task = "open" } = progress ?? {};
    return (
      <section class="card progress" aria-label="Progress">
        <strong>{text}</strong>
        <progress aria-label="Progress" {...(share === null ? {} : { value: share })} max={1} />
        {task === "distill" && (
          <div class="card-line">
            <small>{ready({ edit }) && "You can begin: parts are those of the geometry."}</small>
            <Button text="Cancel" kind="small" onClick={() => send({ type: "cancel" })} />
          </div>
        )}
      </section>
    );
  }
  if (!mesh || (edit?.field.status !== "none" && edit?.field.origin !== "geometry")) return null;
  return (
    <section class="card" aria-label="Features">
      <div class="card-line">
        <span>This shape's features are not learned yet.</span>
        <Button text="Learn features" kind="primary small" onClick={() => send({ type: "distill" })} />
      </div>
    </section>
  );
}

/** A dialog that says why the page has no connection. */
export function Ended() {
  const { ended } = useParts();
  if (ended === null) return null;
  return (
    <Dialog title={ended.title} role="alertdialog">
      <p>{ended.text}</p>
      {ended.button && <Button text={ended.button} kind="primary" onClick={connect} />}
    </Dialog>
  );
}
