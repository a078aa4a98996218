import { useEffect } from "preact/hooks";

import { useParts } from "../store/use";
import type { Viewer } from "../viewer/viewer";
import { Toolbar, Topbar } from "./bars";
import { Help } from "./help";
import { Inspector } from "./inspector";
import { Legend, Proposed, Selection } from "./over_view";
import { Start } from "./start";
import { Ended, ProgressCard, StatusLine, Toasts } from "./status";
import { Timeline } from "./timeline";

/** All panels. Preact does not manage the canvas beneath them. */
export function App({ viewer }: { readonly viewer: Viewer }) {
  const { page, inspector, timeline, dropping, narrow, busy, mesh, dragging, link } = useParts();
  const shape = page === "shape";
  useEffect(() => {
    const shown = { page, inspector: shape && inspector, timeline: shape && timeline, busy, dragging };
    Object.assign(document.documentElement.dataset, shown);
    document.title = shape && mesh ? `${mesh.name} – dfd` : "dfd";
  }, [page, inspector, timeline, busy, mesh, dragging]);
  return (
    <>
      {shape && (
        <>
          <Topbar viewer={viewer} />
          {!narrow && <Toolbar />}
          <Inspector />
          <Timeline />
          <Selection />
          <StatusLine />
          <Legend />
          <Proposed />
        </>
      )}
      {page === "start" && <Start />}
      {page === "waiting" && (
        <main class="start waiting">
          <p role="status">{link === "lost" ? "The server does not answer. Trying again…" : "Connecting…"}</p>
        </main>
      )}
      <ProgressCard />
      <Toasts />
      <Help />
      <Ended />
      {dropping && <div class="dropping">Drop the files to open them</div>}
    </>
  );
}
