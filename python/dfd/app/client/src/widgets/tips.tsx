/** Strips of small pictures beside what they explain; `tools/tips.py` draws them. */

import type { ComponentChildren } from "preact";
import { useEffect, useState } from "preact/hooks";

/** What each picture of a strip shows. */
const CAPTIONS = {
  reach: ["short", "longer", "longest"],
  falloff: ["linear", "sphere", "constant"],
  strength: ["30 %", "60 %", "100 %"],
  instances: ["only", "own pivots", "one pivot"],
  locality: ["none", "2", "8"],
  mask: ["off", "on"],
  pivot: ["base", "middle", "where held"],
  bend: ["at rest", "all along", "at a joint"],
};

type TipName = keyof typeof CAPTIONS;

/** Milliseconds that the pointer rests on something before its strip is shown. */
const PATIENCE = 500;

export function hasTip(name: string): name is TipName {
  return name in CAPTIONS;
}

/** Show the strip of that name while the pointer or the focus is on the children. */
export function Tip({ of, children }: { readonly of: TipName; readonly children: ComponentChildren }) {
  return (
    <div class="tipped" data-tip={of}>
      {children}
    </div>
  );
}

/** The strip that is shown now. */
export function Tips() {
  const [shown, setShown] = useState<{ name: TipName; left: number; top: number } | null>(null);
  useEffect(() => {
    const ended = new AbortController();
    let [timer, on] = [0, null as Element | null];
    const hide = () => {
      clearTimeout(timer);
      on = null;
      setShown(null);
    };
    const show = ({ target }: Event) => {
      const place = target instanceof Element ? target.closest<HTMLElement>("[data-tip]") : null;
      if (place === on) return;
      hide();
      on = place;
      const name = place?.dataset.tip;
      if (!place || !name || !hasTip(name)) return;
      timer = window.setTimeout(() => {
        const { left, top } = place.getBoundingClientRect();
        setShown({ name, left, top });
      }, PATIENCE);
    };
    for (const name of ["pointerover", "focusin"]) addEventListener(name, show, { signal: ended.signal });
    for (const name of ["pointerdown", "keydown", "wheel", "blur"])
      addEventListener(name, hide, { signal: ended.signal, capture: true, passive: true });
    return () => {
      clearTimeout(timer);
      ended.abort();
    };
  }, []);
  if (!shown) return null;
  const captions = CAPTIONS[shown.name];
  return (
    <figure
      class="tip"
      aria-hidden="true"
      ref={(card) => {
        if (!card) return;
        const { width, height } = card.getBoundingClientRect();
        card.style.left = `${Math.max(shown.left - width - 12, 8)}px`;
        card.style.top = `${Math.max(Math.min(shown.top, innerHeight - height - 8), 8)}px`;
      }}
    >
      <img src={`./tips/${shown.name}.webp`} alt="" width={104 * captions.length} height={104} />
      <figcaption>
        {captions.map((caption) => (
          <span key={caption}>{caption}</span>
        ))}
      </figcaption>
    </figure>
  );
}
