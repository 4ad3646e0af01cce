// The choice that follows from an action, with the buttons that do it or leave it.
import type { ComponentChildren, JSX } from "preact";
import { useLayoutEffect, useRef } from "preact/hooks";

interface Choice {
  text: string;
  isBusy: boolean;
  /** It cannot be taken back. */
  isFinal?: boolean;
  act: () => void;
}

/**
 * Stands in the row of the button that asked. Takes the focus from that row, so that the answer is read and given with the
 * keyboard, and gives it back to the row when it goes. Escape leaves it.
 */
export function Question(props: {
  label: string;
  go?: Choice;
  leave: { text: string; act: () => void };
  /** Beside the buttons. */
  note?: string;
  children: ComponentChildren;
}): JSX.Element {
  const { go, leave, note } = props;
  const field = useRef<HTMLFieldSetElement>(null);
  useLayoutEffect(() => {
    const row = field.current?.parentElement;
    const focused = document.activeElement;
    // Somebody who went on to something else meanwhile is not disturbed.
    if (focused === document.body || row?.contains(focused)) field.current?.focus({ preventScroll: true });
    return () => {
      if (field.current?.contains(document.activeElement))
        row?.querySelector<HTMLElement>(".actions button, .commit-head button.quiet")?.focus();
    };
  }, []);
  return (
    <fieldset
      class="dry-run"
      ref={field}
      tabIndex={-1}
      aria-label={props.label}
      onKeyDown={(event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        leave.act();
      }}
    >
      {props.children}
      {go && (
        <button type="button" class={`small ${go.isFinal ? "final" : "primary"}`} disabled={go.isBusy} onClick={go.act}>
          {go.text}
        </button>
      )}
      <button type="button" class="small" onClick={leave.act}>
        {leave.text}
      </button>
      {note && <span class="weak">{note}</span>}
    </fieldset>
  );
}
