// Who drives beside a person: a trained policy, a monitor that takes over, and disturbances to see it do so.

import { nearest } from "./deciding.js";
import { element } from "./elements.js";

// From the outputs of a network to decisions, as `NetworkPolicy.act` of dl2c/policy/network.py.
export class Policy {
  constructor(engine, facts) {
    Object.assign(this, { engine, facts, about: facts.policy });
  }

  // {choices, inputs, shares}: what it asks for here, and the share of each alternative in the softmax of
  // what it weighs against each other, null where it gives numbers.
  asks(moment) {
    const outputs = this.engine.policyOutputs();
    const { kind } = this.about;
    const nothing = {
      choices: this.facts.choices.map(() => 0),
      inputs: this.facts.inputs.map(() => 0),
      shares: null,
    };
    if (kind === "none") return nothing;
    if (kind === "box") return { ...nothing, ...this.#numbers(outputs) };
    if (kind === "runs") return { ...nothing, ...this.#runs(outputs, moment.mask) };
    return { ...nothing, ...this.#alternatives(outputs, moment.mask) };
  }

  // A number for each alternative of each choice: the largest of each counts.
  #alternatives(outputs, mask) {
    const shares = [];
    const choices = this.#cut(outputs).map((own, c) => {
      const open = this.about.masked ? this.#cut(mask)[c] : own.map(() => true);
      shares.push(...softmax(own, open));
      return largest(own, open);
    });
    return { choices, shares };
  }

  // A number for each control path: those count of which all alternatives are possible.
  #runs(outputs, mask) {
    const { runs, masked } = this.about;
    const parts = this.#cut(mask);
    const open = runs.map((run) => !masked || run.every((a, c) => a < 0 || parts[c][a]));
    const weights = softmax(outputs, open);
    const taken = runs[largest(outputs, open)];
    const shares = this.facts.choices.flatMap((choice, c) =>
      choice.alternatives.map((_, a) =>
        runs.reduce((sum, run, r) => sum + (run[c] === a ? weights[r] : 0), 0),
      ),
    );
    return { choices: taken.map((a) => Math.max(a, 0)), shares };
  }

  // Numbers inside the action space: values of inputs, then choices that are rounded, halves to even.
  #numbers(outputs) {
    const { low, high, bounded, inputs, counts, squash } = this.about;
    const values = outputs.map((v, k) => {
      const stretched = bounded ? low[k] + ((v + 1) / 2) * (high[k] - low[k]) : v;
      return this.#rounded(Math.min(Math.max(stretched, low[k]), high[k]));
    });
    const asked = this.facts.inputs.map((input) => values[inputs.indexOf(input.key)]);
    const choices = counts.map((count, c) => {
      const value = values[inputs.length + c];
      return toEven(squash ? ((value + 1) / 2) * (count - 1) : value);
    });
    return { inputs: asked, choices };
  }

  // Actions are of the type of observations.
  #rounded(value) {
    return this.facts.options.obs_dtype === "float32" ? Math.fround(value) : value;
  }

  // One list for each choice.
  #cut(values) {
    let first = 0;
    return this.about.counts.map((count) => values.slice(first, (first += count)));
  }
}

function largest(values, open) {
  let best = -1;
  values.forEach((v, k) => {
    if (open[k] && (best < 0 || v > values[best])) best = k;
  });
  return Math.max(best, 0);
}

function softmax(values, open) {
  const most = Math.max(...values.filter((_, k) => open[k]));
  const weights = values.map((v, k) => (open[k] ? Math.exp(v - most) : 0));
  const sum = weights.reduce((a, b) => a + b, 0);
  return weights.map((w) => (sum > 0 ? w / sum : 0));
}

function toEven(value) {
  const rounded = Math.round(value);
  return Math.abs(value - Math.trunc(value)) === 0.5 && rounded % 2 !== 0 ? rounded - 1 : rounded;
}

// The controls of all that, and what becomes of a request.
export class Drivers {
  // `changed()` is told when someone else drives, `push(size)` moves the state.
  constructor(place, { deciding, facts, policy, changed, push }) {
    Object.assign(this, { deciding, facts, policy });
    const box = (id, text, title) => {
      const made = element("input", { type: "checkbox", id, onchange: changed });
      rows.push(element("label", { title }, made, ` ${text}`));
      return made;
    };
    const rows = [];
    if (policy)
      this.drives = box(
        "drives",
        "Policy drives",
        "The trained policy decides; what it asks for is shown above.",
      );
    this.guards = box("guards", "Monitor", "Where a request is not admissible, the fallback takes over.");
    this.disturbs = box(
      "disturbs",
      "Disturb requests",
      "What is asked for is changed at random before it is tried.",
    );
    this.size = element("input", {
      type: "range",
      id: "size",
      min: 1,
      max: 50,
      value: 10,
      "aria-label": "Size of disturbances in percent of ranges",
    });
    rows.push(element("label", {}, "by ", this.size));
    rows.push(
      element("button", {
        type: "button",
        text: "Push the state",
        title: "Every variable moves at random; a recording ends before.",
        onclick: () => push(this.share),
      }),
    );
    place.append(
      element("legend", { text: policy ? "Policy, monitor, disturbances" : "Monitor, disturbances" }),
      element("div", { class: "row" }, ...rows),
    );
  }

  get share() {
    return Number(this.size.value) / 100;
  }

  // Who decides where the episode stands: {choices, inputs, shares} of the policy, or of the person.
  asks(moment, person) {
    return this.drives?.checked
      ? this.policy.asks(moment)
      : { ...person, shares: this.policy?.asks(moment).shares ?? null };
  }

  // What is tried in the end: {choices, inputs, said}; `said` tells what the monitor did.
  decided(moment, asked) {
    const wanted = this.disturbs.checked ? this.#disturbed(asked) : asked;
    const wrong = this.guards.checked ? this.#inadmissible(moment, wanted) : "";
    return wrong
      ? { ...this.#fallback(moment, wanted), said: `The monitor took over: ${wrong}.` }
      : { ...wanted, said: "" };
  }

  #disturbed({ choices, inputs }) {
    const { share, facts } = this;
    return {
      choices: choices.map((c, k) =>
        Math.random() < share ? Math.floor(Math.random() * facts.choices[k].alternatives.length) : c,
      ),
      inputs: inputs.map((v, k) => {
        const [low, high] =
          facts.batch.action_map === 1 ? [-1, 1] : [facts.inputs[k].low, facts.inputs[k].high];
        return Math.min(Math.max(v + share * (high - low) * (2 * Math.random() - 1), low), high);
      }),
    };
  }

  // What is wrong with a request; "" where it is admissible.
  #inadmissible(moment, { choices, inputs }) {
    const blocked = choices.findIndex((c, k) => !moment.mask[this.deciding.firstOf[k] + c]);
    if (blocked >= 0) return `alternative ${choices[blocked] + 1} has no run`;
    if (this.facts.batch.action_map === 1) return "";
    const outside = inputs.findIndex((value, k) => {
      const intervals = this.deciding.intervals(k, choices, moment, inputs);
      return intervals !== null && !intervals.some(([low, high]) => low <= value && value <= high);
    });
    return outside < 0 ? "" : `${this.facts.inputs[outside].variable} is not admissible`;
  }

  // The marked alternatives that have a run, else the first that do; of inputs the nearest admissible values.
  #fallback(moment, { inputs }) {
    const choices = this.facts.choices.map(({ alternatives }, k) => {
      const open = alternatives.map((_, a) => moment.mask[this.deciding.firstOf[k] + a]);
      const marked = this.deciding.marked(k).find((a) => open[a]);
      return marked ?? Math.max(open.indexOf(true), 0);
    });
    const values = inputs.map((value, k) => {
      const intervals = this.deciding.intervals(k, choices, moment, inputs);
      return intervals === null ? value : nearest(intervals, value);
    });
    return { choices, inputs: values };
  }
}
