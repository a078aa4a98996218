/** Icons made of lines in the color of the text. Coordinates are from 0 to 20. */

const PATHS = {
  hold: "M10 3v4M10 13v4M3 10h4M13 10h4M10 8.5a1.5 1.5 0 1 0 0 3 1.5 1.5 0 0 0 0-3",
  fix: "M7 3h6l-1 6 3 3H5l3-3zM10 12v5",
  paint: "M16 3c-4 1-7 4-8 7l2 2c3-1 6-4 7-8zM8 11c-2 0-3 1-3 3s-1 2-2 2c2 1 6 1 6-2 0-1 0-2-1-3",
  translate:
    "M10 2v16M2 10h16M7.5 4.5 10 2l2.5 2.5M7.5 15.5 10 18l2.5-2.5M4.5 7.5 2 10l2.5 2.5M15.5 7.5 18 10l-2.5 2.5",
  views:
    "M10 9.5V2.5M10 9.5 3.5 15M10 9.5l6.5 5.5M8.2 4.3 10 2.5l1.8 1.8M5.9 15.2 3.5 15l.2-2.4M14.1 15.2l2.4-.2-.2-2.4",
  bend: "M5 17.5C5 9 8 5 15.5 5M12.5 2l3.5 3-3.5 3M3 17.5h4",
  box: "M3.5 3.5h3M9 3.5h2M13.5 3.5h3v3M16.5 9v2M16.5 13.5v3h-3M11 16.5H9M6.5 16.5h-3v-3M3.5 11V9M3.5 6.5v-3",
  rotate: "M16.5 10A6.5 6.5 0 1 1 14 4.9M14.5 1.5V5H11",
  scale: "M3 17 17 3M11 3h6v6M3 11v6h6",
  suggest: "M10 3.5 11.5 8 16 9.5 11.5 11 10 15.5 8.5 11 4 9.5 8.5 8zM16 14v3M14.5 15.5h3",
  compare: "M10 2.5v15M8 5H3.5v10H8M12 5h2M16 5h.5v1.5M16.5 8.5v2M16.5 12.5v2M15 15h-2",
  undo: "M4 8h8a4 4 0 0 1 0 8H8M7 4.5 3.5 8 7 11.5",
  redo: "M16 8H8a4 4 0 0 0 0 8h4M13 4.5 16.5 8 13 11.5",
  open: "M2.5 5.5h5l2 2h8v8.5h-15z",
  save: "M10 3v9M6.5 8.5 10 12l3.5-3.5M3.5 16.5h13",
  camera: "M3 6.5h3l1.5-2h5l1.5 2h3v9.5H3zM10 8.5a2.75 2.75 0 1 0 0 5.5 2.75 2.75 0 0 0 0-5.5",
  wire: "M10 2.5 17 6.5v7L10 17.5 3 13.5v-7zM10 10 3 6.5M10 10l7-3.5M10 10v7.5",
  help: "M7.5 7.5a2.5 2.5 0 1 1 3.5 2.3c-.7.3-1 .8-1 1.7M10 14.3v.2M10 2.5a7.5 7.5 0 1 0 0 15 7.5 7.5 0 0 0 0-15",
  remove: "M5 5l10 10M15 5 5 15",
  reset: "M4 4v4h4M4.5 8A6.5 6.5 0 1 1 3.5 11",
  steps: "M10 4.5a6.5 6.5 0 1 1-6 4M3.5 4.5v4h4M10 7v4l2.5 1.5",
  menu: "M3 5.5h14M3 10h14M3 14.5h14",
  timeline: "M2.5 6h15M2.5 14h15M6 8.5 7.5 10 6 11.5 4.5 10zM13.5 8.5 15 10l-1.5 1.5L12 10zM10 3.5v13",
  play: "M6 3.5v13l10-6.5z",
  pause: "M6.5 4v12M13.5 4v12",
  storePose: "M10 4v12M4 10h12",
  snap: "M5 3v7a5 5 0 0 0 10 0V3h-3.5v7a1.5 1.5 0 0 1-3 0V3zM5 6h3.5M11.5 6H15",
  local: "M4 16V6M4 16h10M4 16l5-5M2.5 7.5 4 6l1.5 1.5M12.5 14.5 14 16l-1.5 1.5M13 3.5a3 3 0 1 0 .1 0",
  xray: "M3 3h9v9H3zM8 8h9v9H8z",
  weights: "M3 15.5h14M4.5 13a5.5 5.5 0 0 1 11 0M7.5 13a2.5 2.5 0 0 1 5 0",
  copy: "M7 7h9v9H7zM4 13V4h9",
  rename: "M4 16l1-4 8.5-8.5 3 3L8 15zM11.5 5.5l3 3",
  isolate: "M3 6V3h3M14 3h3v3M17 14v3h-3M6 17H3v-3M10 6.5a3.5 3.5 0 1 0 .1 0",
  pivot: "M10 2v4M10 14v4M2 10h4M14 10h4M10 6a4 4 0 1 0 .1 0M10 9.5a.5.5 0 1 0 .1 0",
  marks: "M4 16.5a1 1 0 1 0 .1 0M5.5 14.5 12 8M9.5 8H12v2.5M14.5 2.5a3 3 0 1 0 .1 0",
  inspector: "M3 4h14v12H3zM12 4v12",
  more: "M4 10h.1M10 10h.1M16 10h.1",
} as const;

export type IconName = keyof typeof PATHS;

export function Icon({ name }: { readonly name: IconName }) {
  return (
    <svg class="icon" viewBox="0 0 20 20" aria-hidden="true">
      <path d={PATHS[name]} />
    </svg>
  );
}
