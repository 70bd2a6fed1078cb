// What may be decided where an episode stands, and which tests stand against the rest.

import { atomsIn, clearanceOf, conjuncts, failing, holds, written } from "./conditions.js";

const TRIED = 33; // values of an input that are tried to see how nearly it passes

export class Deciding {
  constructor(engine, facts) {
    this.engine = engine;
    this.facts = facts;
    this.conditions = new Map(facts.conditions.map((c) => [`${c.kind} ${c.name}`, c.tree]));
    this.starting = facts.paths.map((path, k) => ({ ...path, number: k })).filter((path) => path.point === 0);
    let first = 0;
    this.firstOf = facts.choices.map((choice) => {
      const own = first;
      first += choice.alternatives.length;
      return own;
    });
  }

  condition(kind, name) {
    return this.conditions.get(`${kind} ${name}`);
  }

  // The alternatives of a choice that are marked as fallback.
  marked(choice) {
    return [...new Set(this.starting.filter((p) => p.marks[choice]).map((p) => p.decisions[choice]))];
  }

  // Values of all inputs, those of the agent as given.
  valuesOf(inputs) {
    return this.facts.all_inputs.map((_, k) => inputs[k] ?? 0);
  }

  // Why an alternative has no run: the tests that fail, the worst first, of the path that comes nearest, each
  // as {tree, by, guilty}; null where it has one.
  against(choice, alternative, moment, inputs) {
    if (moment.mask[this.firstOf[choice] + alternative]) return null;
    const u = this.valuesOf(inputs);
    const found = this.starting
      .filter((path) => path.decisions[choice] === alternative)
      .map((path) => {
        const tests = this.#failed(this.condition("guard", path.number), moment, u);
        return tests.length > 0 ? tests : this.#withoutValue(path, moment, u);
      });
    return found.filter((tests) => tests.length > 0).sort((a, b) => b[0].by - a[0].by)[0] ?? [];
  }

  // The conjuncts of a condition that fail, the worst first.
  #failed(tree, moment, u) {
    const { margin, truth } = this.engine.atoms(moment.x, moment.p, u);
    return conjuncts(tree)
      .filter((part) => !holds(part, truth))
      .map((part) => ({
        tree: part,
        by: clearanceOf(part, this.facts.atoms, margin),
        guilty: failing(part, truth),
      }))
      .sort((a, b) => a.by - b.by);
  }

  // Tests of inputs on a path that fail whatever is tried: for the input and value that come nearest.
  #withoutValue(path, moment, u) {
    const tried = path.inputs
      .filter((input) => input < this.facts.inputs.length)
      .flatMap((input) => {
        const tree = this.condition("admission", `${path.number} ${path.inputs.indexOf(input)}`);
        const { low, high } = this.facts.inputs[input];
        const values = Array.from({ length: TRIED }, (_, k) => low + ((high - low) * k) / (TRIED - 1));
        return values.map((value) => this.#failed(tree, moment, u.with(input, value)));
      });
    return tried.filter((tests) => tests.length > 0).sort((a, b) => b[0].by - a[0].by)[0] ?? [];
  }

  // The paths that a step with these choices may begin with.
  pathsFor(choices, moment, inputs) {
    const { truth } = this.engine.atoms(moment.x, moment.p, this.valuesOf(inputs));
    return this.starting.filter(
      (path) =>
        choices.every((c, k) => path.decisions[k] < 0 || path.decisions[k] === c) &&
        holds(this.condition("guard", path.number), truth),
    );
  }

  // The intervals that an input of the agent may take, given those met before it; null where it is not asked.
  intervals(input, choices, moment, inputs) {
    let met = false;
    const found = [];
    for (const path of this.pathsFor(choices, moment, inputs)) {
      const place = path.inputs.indexOf(input);
      if (place < 0) continue;
      met = true;
      const before = path.inputs.slice(0, place).filter((j) => j < this.facts.inputs.length);
      const given = this.facts.all_inputs.map((_, j) => before.includes(j));
      const u = this.valuesOf(inputs);
      for (const j of before) u[j] = this.#taken(path, j, moment, given, u);
      found.push(...this.engine.admissible(path.number, place, moment.x, moment.p, given, u));
    }
    return met ? joined(found) : null;
  }

  // What an earlier input becomes: the admissible value nearest to what is asked for.
  #taken(path, input, moment, given, u) {
    const place = path.inputs.indexOf(input);
    const earlier = given.map((g, j) => g && path.inputs.indexOf(j) < place);
    return nearest(this.engine.admissible(path.number, place, moment.x, moment.p, earlier, u), u[input]);
  }

  // The conditions of the tests that a step with these decisions meets, for the inputs asked for.
  testsFor(choices, moment, inputs) {
    const paths = this.pathsFor(choices, moment, inputs);
    const trees = paths.flatMap((path) =>
      path.inputs.flatMap((_, place) => conjuncts(this.condition("admission", `${path.number} ${place}`))),
    );
    return distinct(trees).filter((tree) => tree !== true);
  }

  // The conjuncts of all guards where a step starts, but for domains of motions, which are shown as such.
  guards() {
    const trees = this.starting.flatMap((path) => conjuncts(this.condition("guard", path.number)));
    const seen = new Set();
    return distinct(trees).filter((tree) => {
      if (typeof tree === "boolean" || atomsIn(tree).every((k) => this.#isOfDomain(k))) return false;
      const atom = typeof tree === "number" ? this.facts.atoms[tree] : null;
      const keys = [written(tree, this.facts.atoms, true), JSON.stringify(atom?.span ?? tree)];
      const fresh = !keys.some((key) => seen.has(key)); // an `if` has its condition and the opposite
      keys.forEach((key) => seen.add(key));
      return fresh;
    });
  }

  #isOfDomain(atom) {
    const { span } = this.facts.atoms[atom];
    return (
      span !== null && this.facts.flows.some((f) => f.span && f.span[0] <= span[0] && span[1] <= f.span[1])
    );
  }
}

function distinct(trees) {
  return [...new Map(trees.map((tree) => [JSON.stringify(tree), tree])).values()];
}

// The value of intervals that is nearest to one; that one where there are none.
export function nearest(intervals, value) {
  const ends = intervals.map(([low, high]) => Math.min(Math.max(value, low), high));
  return ends.sort((a, b) => Math.abs(a - value) - Math.abs(b - value))[0] ?? value;
}

function joined(intervals) {
  const sorted = [...intervals].sort((a, b) => a[0] - b[0]);
  const result = [];
  for (const [low, high] of sorted) {
    const last = result.at(-1);
    if (last && low <= last[1]) last[1] = Math.max(last[1], high);
    else result.push([low, high]);
  }
  return result;
}
