// The action space as controls: a button for each alternative, a slider for each input.

import { element, say, shown } from "./elements.js";

const SHORT = 60;
const POSITIONS = 1000; // of a slider

// What an alternative does, as the model writes it but briefly: without comments, braces, and tests beside
// other statements.
export function label(text) {
  const inner = text
    .replace(/\/\*.*?\*\//g, " ")
    .replace(/\s+/g, " ")
    .trim();
  const bare = inner.startsWith("{") && inner.endsWith("}") ? inner.slice(1, -1).trim() : inner;
  const statements = statementsOf(bare);
  const acting = statements.filter((s) => !s.startsWith("?"));
  const brief = (acting.length > 0 ? acting : statements).join("; ");
  return brief.length > SHORT ? `${brief.slice(0, SHORT - 1)}…` : brief || "nothing";
}

// The statements of a program, split where they stand side by side.
function statementsOf(text) {
  const found = [""];
  let depth = 0;
  for (const letter of text) {
    depth += "{(".includes(letter) - "})".includes(letter);
    if (letter === ";" && depth === 0) found.push("");
    else found[found.length - 1] += letter;
  }
  return found.map((s) => s.trim()).filter(Boolean);
}

export class Choices {
  // `pressed(choice, alternative)` is called for every alternative that is pressed and has a run.
  constructor(place, facts, pressed, refused) {
    this.facts = facts;
    this.pressed = pressed;
    this.refused = refused;
    this.buttons = [];
    facts.choices.forEach((choice, c) => {
      const made = choice.alternatives.map((text, a) => this.#button(text, c, a));
      place.append(
        element(
          "fieldset",
          {},
          element("legend", {
            text: choice.name || (facts.choices.length > 1 ? `Choice ${c + 1}` : "Choice"),
          }),
          element("div", { class: "alternatives" }, ...made),
        ),
      );
    });
  }

  #button(text, choice, alternative) {
    const number = this.buttons.length;
    const why = element("small");
    const key = number < 9 ? element("kbd", { text: String(number + 1), "aria-hidden": "true" }) : "";
    const button = element(
      "button",
      {
        type: "button",
        class: "alternative",
        title: text,
        "aria-pressed": "false",
        "aria-keyshortcuts": number < 9 ? String(number + 1) : null,
        onclick: () => this.press(number),
      },
      key,
      element("code", { text: label(text) }),
      why,
    );
    this.buttons.push({ button, why, choice, alternative, reason: null, text });
    return button;
  }

  press(number) {
    const found = this.buttons[number];
    if (!found) return false;
    if (found.reason) this.refused(label(found.text), found.reason);
    else this.pressed(found.choice, found.alternative);
    return true;
  }

  // `reasons(choice, alternative)` says why an alternative has no run, in [brief, whole]; null where it has.
  show(chosen, reasons, confidence = null) {
    this.buttons.forEach((b, number) => {
      const [brief, whole] = reasons(b.choice, b.alternative) ?? ["", null];
      b.reason = whole;
      b.button.setAttribute("aria-pressed", String(chosen[b.choice] === b.alternative));
      b.button.setAttribute("aria-disabled", String(Boolean(b.reason)));
      const share = confidence ? `policy ${Math.round(100 * confidence[number])} %` : "";
      say(b.why, brief || share);
      b.button.title = whole ? `${b.text}\n${whole}` : b.text;
    });
  }
}

export class Inputs {
  constructor(place, facts, changed) {
    this.facts = facts;
    this.changed = changed;
    this.squash = facts.batch.action_map === 1;
    this.rows = facts.inputs.map((input, k) => this.#row(place, input, k));
    this.last = 0;
  }

  #row(place, input, k) {
    const [low, high] = this.range(k);
    const quantity = this.facts.variables.find((v) => v.name === input.variable);
    const name = input.variable || "duration of the motion";
    const about = [quantity?.description, quantity?.unit].filter(Boolean).join(", ");
    const id = `input-${k}`;
    const slider = element("input", {
      type: "range",
      id,
      min: 0,
      max: POSITIONS,
      step: 1,
      oninput: () => this.set(k, low + ((high - low) * slider.value) / POSITIONS, slider),
    });
    const number = element("input", {
      type: "number",
      step: "any",
      min: low,
      max: high,
      "aria-label": `${name} as a number`,
      onchange: () => this.set(k, Number(number.value), number),
    });
    const marks = element("div", { class: "admissible", "aria-hidden": "true" });
    const said = element("small");
    const row = element(
      "div",
      { class: "input" },
      element("label", { for: id, text: about ? `${name} (${about})` : name }),
      slider,
      number,
      marks,
      said,
    );
    place.append(row);
    return { row, slider, number, marks, said, low, high };
  }

  // The numbers that may be asked for.
  range(k) {
    const { low, high } = this.facts.inputs[k];
    return this.squash ? [-1, 1] : [low, high];
  }

  set(k, value, from = null) {
    const { low, high } = this.rows[k];
    this.last = k;
    this.changed(k, Math.min(Math.max(Number.isFinite(value) ? value : low, low), high), from);
  }

  // By keys: the input used last by so many hundredths of its range.
  nudge(hundredths, values) {
    if (this.rows.length === 0) return false;
    const { low, high } = this.rows[this.last];
    this.set(this.last, values[this.last] + ((high - low) * hundredths) / 100);
    return true;
  }

  // `intervals(k)` are the admissible ones, null where the value is not asked for.
  show(values, intervals) {
    this.rows.forEach((row, k) => {
      const [low, high] = [row.low, row.high];
      if (document.activeElement !== row.number) row.number.value = String(Number(values[k].toPrecision(6)));
      row.slider.value = ((values[k] - low) / (high - low)) * POSITIONS;
      row.slider.setAttribute("aria-valuetext", shown(values[k]));
      const found = this.squash ? null : intervals(k);
      row.row.classList.toggle("idle", found === null && !this.squash);
      const spans = found ?? [];
      row.marks.replaceChildren(
        ...spans.map(([a, b]) => {
          const span = element("span");
          span.style.left = `${(100 * (a - low)) / (high - low)}%`;
          span.style.width = `${(100 * (b - a)) / (high - low)}%`;
          return span;
        }),
      );
      say(row.said, this.squash ? "a share of what is admissible, from -1 to 1" : said(found));
    });
  }
}

function said(intervals) {
  if (intervals === null) return "not asked for now";
  if (intervals.length === 0) return "no value is admissible";
  const texts = intervals.map(([a, b]) => (a === b ? `${shown(a)}` : `${shown(a)} to ${shown(b)}`));
  return `admissible: ${texts.join(", or ")}`;
}
