import { useState } from "preact/hooks";

import { applyMoment, leave, play, removePose, renamePose, retime, scrub, storePose } from "../actions/timeline";
import type { KeyPose } from "../protocol/messages";
import { store } from "../store/state";
import { useStore } from "../store/use";
import { IconButton, NumberField } from "../widgets/controls";

const NONE: readonly KeyPose[] = [];

export function Timeline() {
  const open = useStore(store, (state) => state.timeline);
  const poses = useStore(store, (state) => state.edit?.poses) ?? NONE;
  const playhead = useStore(store, (state) => state.playhead);
  const playing = useStore(store, (state) => state.playing);
  const away = useStore(store, (state) => state.moment !== null);
  const [chosen, setChosen] = useState(0);
  if (!open) return null;
  const end = Math.max(1, ...poses.map((pose) => pose.seconds));
  const index = Math.min(chosen, poses.length - 1);
  const pose = index >= 0 ? poses[index] : null;
  const choose = (i: number) => {
    setChosen(i);
    store.set({ playing: false });
    scrub(poses[i].seconds);
  };
  return (
    <section class="timeline" aria-label="Timeline">
      <div class="timeline-tools">
        <IconButton icon={playing ? "pause" : "play"} label={playing ? "Pause" : "Play"} keys="Space" onPress={play} />
        <IconButton icon="add" label="Store the present pose" keys="K" onPress={storePose} />
        {away && (
          <>
            <button type="button" class="button small primary" onClick={applyMoment}>
              Use this pose
            </button>
            <button type="button" class="button small" onClick={leave}>
              Back to the edit
            </button>
          </>
        )}
        <span class="spacer" />
        {pose && (
          <>
            <input
              class="rename"
              aria-label="Name of the pose"
              key={`${index} ${pose.name}`}
              defaultValue={pose.name}
              onChange={(event) => renamePose(index, event.currentTarget.value)}
            />
            <NumberField
              label="Seconds"
              value={pose.seconds}
              step={0.1}
              onChange={(seconds) => retime(index, seconds)}
            />
            <span class="unit">s</span>
            <IconButton icon="remove" label={`Remove ${pose.name}`} onPress={() => removePose(index)} />
          </>
        )}
      </div>
      {poses.length === 0 ? (
        <p class="empty">Store poses here to play between them: pose the shape, press K, pose it again, press K.</p>
      ) : (
        <div class="track">
          <input
            type="range"
            aria-label="Moment"
            min={0}
            max={end}
            step={0.01}
            value={playhead}
            aria-valuetext={`${playhead.toFixed(2)} seconds`}
            onInput={(event) => {
              store.set({ playing: false });
              scrub(event.currentTarget.valueAsNumber);
            }}
          />
          {poses.map((own, i) => (
            <button
              key={i}
              type="button"
              class={i === index ? "key selected" : "key"}
              aria-label={`${own.name} at ${own.seconds.toFixed(2)} s`}
              title={own.name}
              ref={(element) => element?.style.setProperty("--at", String(own.seconds / end))}
              onClick={() => choose(i)}
            />
          ))}
        </div>
      )}
    </section>
  );
}
