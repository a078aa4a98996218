/** Strips of small pictures beside what they explain; `docs/tools/tips.py` draws them. */

import { type ComponentChildren, createContext } from "preact";
import { useContext, useEffect, useState } from "preact/hooks";

/** What each picture of a strip shows. */
export const CAPTIONS = {
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

const Tipped = createContext(false);

/** A control's hint as attributes: its title, or beside a strip a line of the strip's card. */
export function useHint(hint: string | undefined) {
  const tipped = useContext(Tipped);
  if (hint === undefined) return {};
  return tipped ? { "data-hint": hint } : { title: hint };
}

/** Show the strip of that name while the pointer or the focus is on the children. */
export function Tip({ of, children }: { readonly of: TipName; readonly children: ComponentChildren }) {
  return (
    <div class="tipped" data-tip={of}>
      <Tipped.Provider value={true}>{children}</Tipped.Provider>
    </div>
  );
}

/** The strip that is shown now. */
export function Tips() {
  const [shown, setShown] = useState<{ name: TipName; hint: string; left: number; top: number } | null>(null);
  useEffect(() => {
    const ended = new AbortController();
    let [timer, on] = [0, null as Element | null];
    const hide = () => {
      clearTimeout(timer);
      on = null;
      setShown(null);
    };
    const show = ({ target }: Event) => {
      const within = (wanted: string) => (target instanceof Element ? target.closest<HTMLElement>(wanted) : null);
      const [place, hinted] = [within("[data-tip]"), within("[data-hint]")];
      if ((hinted ?? place) === on) return;
      hide();
      on = hinted ?? place;
      const name = place?.dataset.tip;
      if (!place || !name || !hasTip(name)) return;
      timer = window.setTimeout(() => {
        const { left, top } = place.getBoundingClientRect();
        setShown({ name, hint: hinted?.dataset.hint ?? "", left, top });
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
      {shown.hint && <p style={{ width: `${104 * captions.length}px` }}>{shown.hint}</p>}
    </figure>
  );
}
