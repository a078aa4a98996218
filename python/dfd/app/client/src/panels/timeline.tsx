import { useState } from "preact/hooks";

import { applyMoment, changePose, leave, play, removePose, scrub } from "../actions/timeline";
import { store } from "../store/state";
import { useParts } from "../store/use";
import { Button, IconButton, ActionButton, NumberField } from "../widgets/controls";

export function Timeline() {
  const { timeline, edit, playhead, playing, moment } = useParts();
  const [chosen, setChosen] = useState(0);
  if (!timeline) return null;
  const poses = edit?.poses ?? [];
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
        <ActionButton action="storePose" />
        {moment && (
          <>
            <Button text="Use this pose" style="primary small" onPress={applyMoment} />
            <Button text="Back to the edit" style="small" onPress={leave} />
          </>
        )}
        <span class="unit spacer">{playhead.toFixed(2)} s</span>
        {pose && (
          <>
            <input
              class="rename"
              aria-label="Name of the pose"
              key={`${index} ${pose.name}`}
              defaultValue={pose.name}
              onChange={({ currentTarget: { value } }) => value.trim() && changePose(index, { name: value.trim() })}
            />
            <NumberField
              label="Seconds"
              value={pose.seconds}
              step={0.1}
              onChange={(seconds) => changePose(index, { seconds: Math.max(seconds, 0) })}
            />
            <span class="unit">s</span>
            <IconButton icon="remove" label={`Remove ${pose.name}`} onPress={() => removePose(index)} />
          </>
        )}
      </div>
      {poses.length === 0 ? (
        <p class="empty">Pose the shape, and press + to store the pose. Store two poses to play between them.</p>
      ) : (
        <>
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
          <div class="segmented" role="group" aria-label="Poses">
            {poses.map(({ name, seconds }, i) => (
              <button key={i} type="button" aria-pressed={i === index} onClick={() => choose(i)}>
                {name} · {seconds.toFixed(2)} s
              </button>
            ))}
          </div>
        </>
      )}
    </section>
  );
}
