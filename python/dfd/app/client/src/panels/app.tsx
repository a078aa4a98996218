import { useEffect, useState } from "preact/hooks";

import { upload } from "../actions/files";
import { useParts } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { Help } from "./help";
import { Inspector } from "./inspector";
import { Start } from "./start";
import { Ended, ProgressCard, StatusLine, Toasts } from "./status";
import { Timeline } from "./timeline";
import { Toolbar } from "./toolbar";
import { Topbar } from "./topbar";

/** All panels; the canvas lies beneath them and is none of Preact's. */
export function App({ viewer }: { readonly viewer: Viewer }) {
  const { page, inspector, timeline } = useParts();
  const shape = page === "shape";
  useEffect(() => {
    const root = document.documentElement;
    root.dataset.page = page;
    root.dataset.inspector = String(shape && inspector);
    root.dataset.timeline = String(shape && timeline);
  }, [page, inspector, timeline]);
  return (
    <>
      {shape && (
        <>
          <Topbar viewer={viewer} />
          <Toolbar />
          <Inspector />
          <Timeline />
          <StatusLine />
        </>
      )}
      {page === "start" && <Start />}
      {page === "waiting" && <Waiting />}
      <ProgressCard />
      <DropTarget />
      <Toasts />
      <Help />
      <Ended />
    </>
  );
}

function Waiting() {
  const { link } = useParts();
  return (
    <main class="start waiting">
      <p role="status">{link === "lost" ? "The server does not answer. Trying again…" : "Connecting…"}</p>
    </main>
  );
}

/** Files may be dropped anywhere. */
function DropTarget() {
  const [over, setOver] = useState(false);
  useEffect(() => {
    const ended = new AbortController();
    const { signal } = ended;
    const hasFiles = (event: DragEvent) => event.dataTransfer?.types.includes("Files") ?? false;
    const enter = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      setOver(true);
    };
    const leave = (event: DragEvent) => {
      if (event.relatedTarget === null) setOver(false);
    };
    const drop = (event: DragEvent) => {
      if (!hasFiles(event)) return;
      event.preventDefault();
      setOver(false);
      void upload([...(event.dataTransfer?.files ?? [])]);
    };
    addEventListener("dragenter", enter, { signal });
    addEventListener("dragover", enter, { signal });
    addEventListener("dragleave", leave, { signal });
    addEventListener("drop", drop, { signal });
    return () => ended.abort();
  }, []);
  return over ? <div class="drop-veil">Drop to open</div> : null;
}
