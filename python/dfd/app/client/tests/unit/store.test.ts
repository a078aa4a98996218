import { describe, expect, it, vi } from "vitest";

import type { StateMessage } from "../../src/protocol/messages";
import { serverPoses, store as pageStore } from "../../src/store/state";
import { createStore } from "../../src/store/store";

describe("createStore", () => {
  it("calls a watcher only when its own part of the state changes", () => {
    const store = createStore({ a: 1, b: "x" });
    const a = vi.fn();
    const b = vi.fn();
    store.watch((state) => state.a, a);
    store.watch((state) => state.b, b);
    store.set({ a: 2 });
    store.set({ a: 2 });
    expect(a.mock.calls).toEqual([[2]]);
    expect(b).not.toHaveBeenCalled();
  });

  it("does not change earlier states", () => {
    const store = createStore({ a: 1 });
    const before = store.get();
    store.set({ a: 2 });
    expect(before).toEqual({ a: 1 });
    expect(store.get()).toEqual({ a: 2 });
  });
});

describe("serverPoses", () => {
  it("is true for poses that the shader does not support, unless the page shows the original shape", () => {
    const edit = { preset: "default", handles: [] } as unknown as StateMessage;
    const state = { ...pageStore.get(), edit };
    expect(serverPoses(state)).toBe(false);
    const paper = { ...state, edit: { ...edit, preset: "paper" as const } };
    expect(serverPoses(paper)).toBe(true);
    expect(serverPoses({ ...paper, comparing: true })).toBe(false);
  });
});
