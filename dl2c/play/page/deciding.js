// What may be decided where an episode stands, and which tests stand against the rest.

import { clearanceOf, conjuncts, failing, holds } from "./conditions.js";

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

  // Values of all inputs, those of the agent as given.
  valuesOf(inputs) {
    return this.facts.all_inputs.map((_, k) => inputs[k] ?? 0);
  }

  // Why an alternative has no run: the comparisons to blame, and by how much they fail; null where it has one.
  against(choice, alternative, moment, inputs) {
    if (moment.mask[this.firstOf[choice] + alternative]) return null;
    const { atoms } = this.facts;
    const u = this.valuesOf(inputs);
    const { margin, truth } = this.engine.atoms(moment.x, moment.p, u);
    const found = this.starting.filter((path) => path.decisions[choice] === alternative).map((path) => {
      const guard = this.condition("guard", path.number);
      if (!holds(guard, truth)) return { guilty: failing(guard, truth), by: clearanceOf(guard, atoms, margin) };
      return this.#withoutValue(path, moment, u);
    });
    const nearest = found.filter(Boolean).sort((a, b) => b.by - a.by)[0];
    return nearest ?? { guilty: [], by: NaN };
  }

  // The tests of inputs on a path that no tried value passes; of those the one that comes nearest.
  #withoutValue(path, moment, u) {
    const { atoms, inputs } = this.facts;
    let best = null;
    path.inputs.forEach((input, place) => {
      const tree = this.condition("admission", `${path.number} ${place}`);
      if (input >= inputs.length) return;
      const { low, high } = inputs[input];
      for (let k = 0; k < TRIED; k++) {
        const tried = u.with(input, low + ((high - low) * k) / (TRIED - 1));
        const { margin, truth } = this.engine.atoms(moment.x, moment.p, tried);
        const by = clearanceOf(tree, atoms, margin);
        if (!holds(tree, truth) && (best === null || by > best.by)) best = { guilty: failing(tree, truth), by };
      }
    });
    return best;
  }

  // The paths that a step with these choices may begin with.
  pathsFor(choices, moment, inputs) {
    const { truth } = this.engine.atoms(moment.x, moment.p, this.valuesOf(inputs));
    return this.starting.filter((path) =>
      choices.every((c, k) => path.decisions[k] < 0 || path.decisions[k] === c)
      && holds(this.condition("guard", path.number), truth));
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
      path.inputs.flatMap((_, place) => conjuncts(this.condition("admission", `${path.number} ${place}`))));
    return distinct(trees).filter((tree) => tree !== true);
  }

  // The conjuncts of all guards where a step starts.
  guards() {
    const trees = this.starting.flatMap((path) => conjuncts(this.condition("guard", path.number)));
    const seen = new Set();
    return distinct(trees).filter((tree) => {
      if (typeof tree === "boolean") return false;
      const place = typeof tree === "number" ? JSON.stringify(this.facts.atoms[tree].span) : JSON.stringify(tree);
      const fresh = place === "null" || !seen.has(place); // an `if` has its condition and the opposite
      seen.add(place);
      return fresh;
    });
  }
}

export function distinct(trees) {
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
