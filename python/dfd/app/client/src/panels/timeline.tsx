import { useRef, useState } from "preact/hooks";

import { applyMoment, changePose, leave, play, removePose, scrub } from "../actions/timeline";
import { store } from "../store/state";
import { useParts } from "../store/use";
import { ActionButton, Button, IconButton, NumberField, Toggle } from "../widgets/controls";

/** Key poses on an axis of time. A pose is dragged to another moment, and the axis to any moment between the poses. */
export function Timeline() {
  const { timeline, edit, playhead, playing, moment, pose: chosen } = useParts();
  if (!timeline) return null;
  const poses = edit?.poses ?? [];
  const index = Math.min(chosen, poses.length - 1);
  const pose = index >= 0 ? poses[index] : null;
  return (
    <section class="timeline" aria-label="Timeline">
      <div class="timeline-tools">
        <IconButton icon={playing ? "pause" : "play"} label={playing ? "Pause" : "Play"} keys="Space" onClick={play} />
        <ActionButton action="storePose" />
        {moment && (
          <>
            <Button text="Use this pose" kind="primary small" onClick={applyMoment} />
            <Button text="Back to the edit" kind="small" onClick={leave} />
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
              onFocus={(event) => event.currentTarget.select()}
              onChange={({ currentTarget: { value } }) => value.trim() && changePose(index, { name: value.trim() })}
            />
            <NumberField
              label="Seconds"
              value={pose.seconds}
              step={0.1}
              onChange={(seconds) => changePose(index, { seconds: Math.max(seconds, 0) })}
            />
            <span class="unit">s</span>
            <Toggle
              label="Ease"
              hint="Motions slow down towards this pose and start slowly from it"
              value={pose.ease ?? false}
              onChange={(ease) => changePose(index, { ease })}
            />
            <IconButton icon="remove" label={`Remove ${pose.name}`} onClick={() => removePose(index)} />
          </>
        )}
      </div>
      {poses.length === 0 ? (
        <p class="empty">Pose the shape, and press + to store the pose. Store two poses to play between them.</p>
      ) : (
        <Axis chosen={index} />
      )}
    </section>
  );
}

function Axis({ chosen }: { readonly chosen: number }) {
  const { edit, playhead } = useParts();
  const poses = edit?.poses ?? [];
  const box = useRef<HTMLDivElement>(null);
  /** The pose that the pointer drags, and its moment. */
  const [dragged, setDragged] = useState<{ readonly index: number; readonly seconds: number } | null>(null);
  const end = Math.max(1, ...poses.map(({ seconds }) => seconds)) * 1.1;
  const secondsAt = (event: PointerEvent) => {
    const { left, width } = (box.current as HTMLElement).getBoundingClientRect();
    return Math.round(Math.min(Math.max(((event.clientX - left) / width) * end, 0), end) * 20) / 20;
  };
  const choose = (index: number) => {
    store.set({ playing: false, pose: index });
    scrub(poses[index].seconds);
  };
  return (
    <div class="time-axis" ref={box}>
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
      <div role="group" aria-label="Poses">
        {poses.map(({ name, seconds }, i) => {
          const at = dragged?.index === i ? dragged.seconds : seconds;
          return (
            <button
              key={i}

              class="key"
              aria-pressed={i === chosen}
              aria-label={`${name} at ${seconds.toFixed(2)} seconds`}
              title={`${name}: drag to another moment`}
              style={{ "--at": at / end }}
              onPointerDown={(event) => {
                event.currentTarget.setPointerCapture(event.pointerId);
                choose(i);
                setDragged({ index: i, seconds });
              }}
              onPointerMove={(event) => dragged?.index === i && setDragged({ index: i, seconds: secondsAt(event) })}
              onPointerUp={() => {
                if (dragged && Math.abs(dragged.seconds - seconds) >= 0.05) {
                  changePose(i, { seconds: dragged.seconds });
                  scrub(dragged.seconds);
                }
                setDragged(null);
              }}
              onClick={(event) => event.detail === 0 && choose(i)}
            >
              <span>{name}</span>
            </button>
          );
        })}
      </div>
    </div>
  );
}
