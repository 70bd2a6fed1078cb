// Margins as bars, and the state as a table in which a beginning can be written.

import { clearanceOf, holds, written } from "./conditions.js";
import { element, say, shown } from "./elements.js";

export class Bars {
  constructor(place, facts) {
    this.place = place;
    this.facts = facts;
    this.largest = new Map();
    this.rows = new Map();
  }

  // `groups` are [title, trees]; margin and truth those of all comparisons.
  show(groups, margin, truth) {
    const layout = JSON.stringify(groups);
    if (layout !== this.layout) this.#build(groups);
    this.layout = layout;
    for (const [key, row] of this.rows) this.#fill(key, row, margin, truth);
  }

  #build(groups) {
    this.rows.clear();
    const parts = groups
      .filter(([, trees]) => trees.length > 0)
      .map(([title, trees]) =>
        element("div", {}, element("h3", { text: title }), ...trees.map((tree) => this.#row(title, tree))),
      );
    this.place.replaceChildren(...parts);
  }

  #row(group, tree) {
    const text = written(tree, this.facts.atoms);
    const title = written(tree, this.facts.atoms, true);
    const fill = element("span", { class: "fill" });
    const value = element("span", { class: "value" });
    const row = element(
      "div",
      { class: "bar" },
      element("code", { text, title }),
      element("span", { class: "track", "aria-hidden": "true" }, fill),
      value,
    );
    this.rows.set(`${group} ${JSON.stringify(tree)}`, { tree, fill, value });
    return row;
  }

  #fill(key, { tree, fill, value }, margin, truth) {
    const by = clearanceOf(tree, this.facts.atoms, margin);
    const good = holds(tree, truth);
    const size = Number.isFinite(by) ? Math.abs(by) : 0;
    const most = Math.max(this.largest.get(key) ?? 0, size, 1e-9);
    this.largest.set(key, most);
    fill.className = `fill ${good ? "yes" : "no"}`;
    fill.style.width = `${(50 * size) / most}%`;
    say(value, `${good ? "✓" : "✗"} ${shown(by)}`);
    value.className = `value ${good ? "good" : "bad"}`;
  }
}

export class States {
  // `begin(state)` starts an episode in a state by name, `check(state)` says what stands against it.
  constructor(place, facts, { begin, check, seed }) {
    this.facts = facts;
    this.check = check;
    this.quantities = [...facts.variables, ...facts.constants];
    this.problem = element("p", { role: "status" });
    this.begin = element("button", {
      type: "button",
      text: "Begin here",
      disabled: true,
      onclick: () => begin(this.written()),
    });
    this.seed = element("input", {
      type: "text",
      inputmode: "numeric",
      id: "seed",
      onchange: () => seed(this.seed.value),
    });
    this.cells = this.quantities.map((q) => this.#cells(q));
    const head = element(
      "tr",
      {},
      ...["name", "now", "beginning"].map((text) => element("th", { text, scope: "col" })),
    );
    place.append(
      element(
        "div",
        { class: "row" },
        element("label", { for: "seed", text: "Seed" }),
        this.seed,
        this.begin,
      ),
      this.problem,
      element("table", {}, element("thead", {}, head), element("tbody", {}, ...this.cells.map((c) => c.row))),
    );
  }

  #cells(q) {
    const about = [q.description, q.unit].filter(Boolean).join(", ");
    const name = element(
      "th",
      { scope: "row" },
      element("code", { text: q.name }),
      ...(about ? [element("small", { text: about })] : []),
    );
    const now = element("td", { class: "number" });
    const fixed = q.value !== null && q.value !== undefined;
    const field = element("input", {
      type: "number",
      step: "any",
      "aria-label": `${q.name} at the beginning`,
      disabled: fixed,
      title: fixed ? "fixed by the model" : null,
      oninput: () => this.#edited(),
    });
    return { now, field, row: element("tr", {}, name, now, element("td", {}, field)) };
  }

  // What is written in the fields, by name; constants that are fixed are left out.
  written() {
    const entries = this.quantities.map((q, k) => [q, this.exact?.[k] ?? Number(this.cells[k].field.value)]);
    return Object.fromEntries(
      entries.filter(([q]) => q.value === null || q.value === undefined).map(([q, value]) => [q.name, value]),
    );
  }

  #edited() {
    this.exact = this.cells.map(({ field }, k) =>
      field.value === field.dataset.written
        ? this.beginning[k]
        : field.value === ""
          ? NaN
          : Number(field.value),
    );
    this.#judge();
  }

  #judge() {
    const problem = this.check(this.written());
    this.begin.disabled = problem !== "";
    say(this.problem, problem);
    this.problem.className = problem ? "bad" : "";
  }

  // Fills the fields with how an episode began.
  began(values, seed) {
    this.beginning = [...values];
    this.exact = [...values];
    this.seed.value = String(seed);
    this.cells.forEach(({ field }, k) => {
      field.value = field.dataset.written = String(values[k]);
    });
    say(this.problem, "");
    this.begin.disabled = false;
  }

  now(values) {
    this.cells.forEach(({ now }, k) => say(now, shown(values[k])));
  }
}
