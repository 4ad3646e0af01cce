// Edits one value with the widget that fits its type.
import { useSignal } from "@preact/signals";
import type { JSX } from "preact";
import { hexOfLinear, linearOfHex, numberOf, numbersOf, short, widgetFor } from "../core/format";
import type { Json, Property } from "../core/protocol";
import { usePage } from "./context";

interface WidgetProps {
  property: Property;
  size: number;
  label: string;
  set: (value: Json) => void;
}

/** The type that a widget edits: a list with one color, as most display colors are, is edited as that color. */
export function typeOf(property: Property): string {
  const isOneColor = property.type === "color3f[]" && Array.isArray(property.value) && property.value.length === 1;
  return isOneColor ? "color3f" : property.type;
}

/** `place` is where a refusal of the edit is shown. */
export function ValueEditor({
  property,
  path,
  place,
}: {
  property: Property;
  path: string;
  place: string;
}): JSX.Element {
  const { session } = usePage();
  const type = typeOf(property);
  const isInList = type !== property.type;
  const { widget, size } = widgetFor(type, property.allowed);
  const time = property.animated ? session.state.value?.time : null;
  const set = (value: Json) =>
    void session.edit(
      "set",
      { path, name: property.name, value: isInList ? [value] : value, ...(time == null ? {} : { time }) },
      place,
    );
  const shown = isInList ? { ...property, type, value: (property.value as Json[])[0] ?? null } : property;
  const props: WidgetProps = { property: shown, size, label: property.name, set };
  switch (widget) {
    case "bool":
      return <BoolWidget {...props} />;
    case "token":
      return <TokenWidget {...props} />;
    case "color":
      return <ColorWidget {...props} />;
    case "vector":
      return <VectorWidget {...props} />;
    case "number":
    case "integer":
      return <NumberWidget {...props} isInteger={widget === "integer"} />;
    default:
      return <TextWidget {...props} />;
  }
}

function BoolWidget({ property, label, set }: WidgetProps): JSX.Element {
  return (
    <input
      type="checkbox"
      aria-label={label}
      checked={property.value === true}
      onChange={(event) => set(event.currentTarget.checked)}
    />
  );
}

function TokenWidget({ property, label, set }: WidgetProps): JSX.Element {
  const value = typeof property.value === "string" ? property.value : property.valueText;
  return (
    <select aria-label={label} value={value} onChange={(event) => set(event.currentTarget.value)}>
      {!property.allowed.includes(value) && <option value={value}>{value || "no value"}</option>}
      {property.allowed.map((token) => (
        <option key={token} value={token}>
          {token}
        </option>
      ))}
    </select>
  );
}

function NumberWidget({ property, label, set, isInteger }: WidgetProps & { isInteger: boolean }): JSX.Element {
  const text = typeof property.value === "number" ? short(property.value) : "";
  return <NumberField label={label} text={text} isInteger={isInteger} commit={set} />;
}

function VectorWidget({ property, size, label, set }: WidgetProps): JSX.Element {
  const numbers = numbersOf(property.value, size) ?? new Array<number>(size).fill(0);
  const isInteger = /^int\d|i$/.test(property.type);
  return (
    <span class="vector">
      {numbers.map((number, index) => (
        <NumberField
          key={index}
          label={`${label} ${"xyzw"[index]}`}
          text={short(number)}
          isInteger={isInteger}
          commit={(value) => set(numbers.map((old, at) => (at === index ? value : old)))}
        />
      ))}
    </span>
  );
}

function ColorWidget({ property, size, label, set }: WidgetProps): JSX.Element {
  const numbers = numbersOf(property.value, size);
  return (
    <span class="color">
      <input
        type="color"
        aria-label={label}
        value={hexOfLinear(numbers ?? [0, 0, 0])}
        onChange={(event) => set([...linearOfHex(event.currentTarget.value), ...(numbers ?? []).slice(3, size)])}
      />
      <span class="weak">{numbers ? numbers.map(short).join(" ") : property.valueText}</span>
    </span>
  );
}

function TextWidget({ property, label, set }: WidgetProps): JSX.Element {
  const value = typeof property.value === "string" ? property.value : property.valueText;
  return <Field label={label} text={value} commit={set} isValid={() => true} />;
}

function NumberField(props: {
  label: string;
  text: string;
  isInteger: boolean;
  commit: (value: number) => void;
}): JSX.Element {
  return (
    <Field
      label={props.label}
      text={props.text}
      isNumber
      isValid={(text) => numberOf(text, props.isInteger) !== undefined}
      commit={(text) => props.commit(numberOf(text, props.isInteger) as number)}
    />
  );
}

/** A text that is sent when the person has finished: Enter or another place sends it, Escape leaves it. What is typed
 * stays when the value changes meanwhile. */
function Field(props: {
  label: string;
  text: string;
  isNumber?: boolean;
  isValid: (text: string) => boolean;
  commit: (text: string) => void;
}): JSX.Element {
  const draft = useSignal<string | undefined>(undefined);
  const isBad = draft.value !== undefined && !props.isValid(draft.value);
  const finish = () => {
    const text = draft.value;
    draft.value = undefined;
    if (text !== undefined && text !== props.text && props.isValid(text)) props.commit(text);
  };
  return (
    <input
      type="text"
      class={`field${props.isNumber ? " number" : ""}${isBad ? " bad" : ""}`}
      inputMode={props.isNumber ? "decimal" : "text"}
      aria-label={props.label}
      aria-invalid={isBad}
      spellcheck={false}
      value={draft.value ?? props.text}
      onInput={(event) => {
        draft.value = event.currentTarget.value;
      }}
      onBlur={finish}
      onKeyDown={(event) => {
        if (event.key === "Enter") finish();
        else if (event.key === "Escape") draft.value = undefined;
        else return;
        event.stopPropagation();
      }}
    />
  );
}
