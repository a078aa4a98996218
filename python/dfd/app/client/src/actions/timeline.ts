/** Store, scrub and play key poses. The transforms of the handles change only when a shown moment is applied. */

import { interpolate, REST, pickTransform, type Transform } from "../posing/affine";
import type { KeyPose } from "../protocol/messages";
import { store, transformOf } from "../store/state";
import { send } from "./connection";
import { poseTransform, seenTransforms, showAhead } from "./edit";
import { note } from "./toasts";

const SECONDS_BETWEEN = 1;

/** Poses at most this many seconds apart count as one moment. */
const SAME_MOMENT = 0.05;

/** The moment of the pose that was stored last, unless the playhead has moved since. */
let stored = NaN;

/** Store the edit as a pose at the playhead, in place of a pose there. A new pose after the last one is a second later. */
export function storePose(): void {
  const { edit, playhead } = store.get();
  if (!edit) return;
  if (edit.handles.length === 0) {
    note("Add a handle first. A pose stores the transforms of the handles.");
    return;
  }
  const transforms = edit.handles.map((handle) => poseTransform([handle.handle, transformOf(handle)]));
  const there = edit.poses.findIndex((pose) => Math.abs(pose.seconds - playhead) < SAME_MOMENT);
  const end = edit.poses[edit.poses.length - 1]?.seconds ?? -SECONDS_BETWEEN;
  // A user who stores one pose after the other adds poses. A user who has moved the playhead to a pose replaces it.
  const appends = there >= 0 && there === edit.poses.length - 1 && stored === playhead;
  if (there >= 0 && !appends) {
    changePose(there, { transforms });
    note(`${edit.poses[there].name} is replaced.`);
    store.set({ moment: null, pose: there });
    return;
  }
  const seconds = appends || edit.poses.length === 0 ? end + SECONDS_BETWEEN : playhead;
  const pose: KeyPose = { name: `Pose ${edit.poses.length + 1}`, seconds, ease: true, transforms };
  const poses = sorted([...edit.poses, pose]);
  send({ type: "set_poses", poses });
  store.set({ playhead: seconds, moment: null, pose: poses.indexOf(pose) });
  stored = seconds;
}

export function removePose(index: number): void {
  send({ type: "set_poses", poses: (store.get().edit?.poses ?? []).filter((_, i) => i !== index) });
  leave();
}

/** Change a pose. It stays the chosen one, even if it moves past another pose. */
export function changePose(index: number, part: Partial<KeyPose>): void {
  const poses = [...(store.get().edit?.poses ?? [])];
  const changed = { ...poses[index], ...part };
  poses[index] = changed;
  const ordered = sorted(poses);
  send({ type: "set_poses", poses: ordered });
  store.set({ pose: ordered.indexOf(changed) });
}

function sorted(poses: KeyPose[]): KeyPose[] {
  return [...poses].sort((a, b) => a.seconds - b.seconds);
}

/** Return the share of a segment's motion at the share `t` of its time. The motion is slow beside poses that ease. */
export function eased(t: number, from: boolean, to: boolean): number {
  const [begin, end] = [from ? 0 : 1, to ? 0 : 1];
  return t * t * (3 - 2 * t) + begin * t * (1 - t) ** 2 - end * t * t * (1 - t);
}

/** Return the transform of each handle at a moment. A handle that a pose does not contain is at rest in that pose. */
export function momentAt(poses: readonly KeyPose[], seconds: number): Map<number, Transform> {
  const after = poses.findIndex((pose) => pose.seconds > seconds);
  const last = poses.length - 1;
  const [from, to] = after < 0 ? [last, last] : [Math.max(after - 1, 0), after];
  const [a, b] = [poses[from], poses[to]];
  const span = b.seconds - a.seconds;
  const time = span > 0 ? Math.min(Math.max((seconds - a.seconds) / span, 0), 1) : 0;
  const part = eased(time, a.ease ?? false, b.ease ?? false);
  const handles = new Set(poses.flatMap((pose) => pose.transforms.map((own) => own.handle)));
  const of = (pose: KeyPose, handle: number): Transform => {
    const own = pose.transforms.find((transform) => transform.handle === handle);
    return own ? pickTransform({ ...REST, ...own }) : REST;
  };
  return new Map([...handles].map((handle) => [handle, interpolate(of(a, handle), of(b, handle), part)]));
}

export function scrub(seconds: number): void {
  const poses = store.get().edit?.poses ?? [];
  stored = NaN;
  store.set({ playhead: seconds, moment: poses.length > 0 ? momentAt(poses, seconds) : null });
}

/** Show the edit again. */
export function leave(): void {
  store.set({ moment: null, playing: false });
}

/** Set the transforms of the edit to those of the shown moment. */
export function applyMoment(): void {
  const { moment } = store.get();
  const transforms = seenTransforms();
  if (!moment || !transforms) return;
  const request = send({ type: "pose", transforms });
  moment.forEach((transform, handle) => showAhead(handle, { transform }, request));
  leave();
}

export function play(): void {
  const { playing, edit, playhead } = store.get();
  const poses = edit?.poses ?? [];
  if (poses.length < 2) note("Store at least two poses to play between them.");
  store.set({ playing: !playing && poses.length > 1 });
  if (!store.get().playing) return;
  const [start, end] = [poses[0].seconds, poses[poses.length - 1].seconds];
  const from = playhead >= end ? start : playhead;
  const begun = performance.now();
  const frame = () => {
    if (!store.get().playing) return;
    // The animation repeats until the user stops it.
    const gone = from - start + (performance.now() - begun) / 1000;
    scrub(start + (gone % Math.max(end - start, 1e-3)));
    requestAnimationFrame(frame);
  };
  requestAnimationFrame(frame);
}
