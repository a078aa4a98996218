/** Send a small picture of the edit for the start page, some time after it was saved. */

import { store } from "../store/state";
import { ask } from "./connection";

/** Milliseconds of rest after which a picture is made, because drawing takes time. */
const REST = 1200;

export function keepPictures(draw: () => string): void {
  let timer = 0;
  const keep = () => {
    const { saved, drawn, dragging, moment, page } = store.get();
    if (saved && drawn && !dragging && !moment && page === "shape")
      void ask({ type: "keep_picture", picture: draw() }, true);
  };
  store.watch(
    ({ saved, mesh }) => [saved, mesh],
    () => {
      clearTimeout(timer);
      const { saved, edit } = store.get();
      if (saved && edit?.handles.length) timer = window.setTimeout(keep, REST);
    },
  );
}
