// An episode: the steps taken, each with all that leads back to it, and its recording for `dl2c replay`.

export class Episode {
  constructor(engine, facts) {
    this.engine = engine;
    this.facts = facts;
    this.names = [...facts.variables, ...facts.constants].map((q) => q.name);
  }

  // Begins with a seed, in a drawn state or, where `state` is given by name, in that one. Throws Refused.
  begin(seed, state = null) {
    if (state === null) this.engine.reset(seed);
    else this.engine.resetTo(seed, ...this.arrays(state));
    this.start = { seed, state: state === null ? null : { ...state } };
    this.steps = [];
    this.at = 0;
    this.first = this.#moment();
  }

  // Stands in the middle of all bounds, where nothing runs, until a beginning is given.
  beginNowhere(seed) {
    const middle = (q) => q.value ?? ((q.low ?? 0) + (q.high ?? q.low ?? 0)) / 2;
    this.engine.setState(this.facts.variables.map(middle), this.facts.constants.map(middle));
    this.start = { seed, state: null };
    this.steps = [];
    this.at = 0;
    this.first = { ...this.#moment(), ended: true };
  }

  // Values of variables and of constants in a state by name.
  arrays(state) {
    const values = (quantities) => quantities.map((q) => q.value ?? state[q.name]);
    return [values(this.facts.variables), values(this.facts.constants)];
  }

  // What there is to know of where the episode stands.
  get now() {
    return this.at === 0 ? this.first : this.steps[this.at - 1];
  }

  get over() {
    return this.now.ended;
  }

  // One step from where the episode stands; what was after that is forgotten.
  step(choices, inputs) {
    const paths = this.engine.pathsAhead(choices, inputs);
    const begun = this.now;
    this.engine.step(choices, inputs);
    this.steps.length = this.at;
    const inside = this.engine.inside();
    this.steps.push({ ...this.#moment(), choices: [...choices], inputs: [...inputs], paths, begun, inside });
    this.at += 1;
    return this.now;
  }

  // Back to, or on to, where `count` steps were taken.
  seek(count) {
    this.at = Math.max(0, Math.min(count, this.steps.length));
    this.engine.restore(this.now.snapshot);
  }

  // Moves the state by hand. What follows cannot be replayed, so the recording ends before.
  disturb(x) {
    this.engine.setState(x, this.now.p);
    const moved = { ...this.now, ...this.#standing(), original: this.now };
    if (this.at === 0) this.first = moved;
    else this.steps[this.at - 1] = moved;
    this.steps.length = this.at;
  }

  // How many steps a recording holds: those before the state was first moved by hand.
  get recorded() {
    if (this.first.original) return 0;
    const moved = this.steps.slice(0, this.at).findIndex((m) => m.original);
    return moved < 0 ? this.at : moved + 1;
  }

  #standing() {
    return { ...this.engine.state(), mask: this.engine.mask(), snapshot: this.engine.save() };
  }

  #moment() {
    return { ...this.#standing(), ...this.engine.result() };
  }

  #named(moment) {
    const values = [...moment.x, ...moment.p];
    return Object.fromEntries(this.names.map((name, k) => [name, values[k]]));
  }

  // The steps up to where the episode stands, as text that `dl2c replay` reads.
  recording() {
    const { facts } = this;
    const steps = this.steps.slice(0, this.recorded).map((m) => m.original ?? m);
    const last = steps.at(-1);
    return json({
      format: "dl2c episode",
      format_version: 1,
      dl2c_version: facts.version,
      engine: "webassembly",
      model: facts.source,
      options: facts.options,
      start: { seed: this.start.seed, number: 0, state: this.start.state },
      initial: this.#named(this.first.original ?? this.first),
      steps: steps.map((m) => ({
        action: this.#action(m),
        state: this.#named(m),
        time: m.time,
        duration: m.duration,
        reward: Number.isFinite(m.reward) ? m.reward : word(m.reward),
        cost: m.cost,
        blocked: m.blocked,
        postcondition: m.postcondition,
      })),
      status: last ? facts.statuses[last.status] : "none",
      reason: last ? facts.reasons[last.reason] : "",
    });
  }

  #action(moment) {
    const { inputs, choices } = this.facts;
    if (inputs.length + choices.length === 0) return 0;
    return Object.fromEntries([
      ...inputs.map((i, k) => [i.key, [moment.inputs[k]]]),
      ...choices.map((c, k) => [c.key, moment.choices[k]]),
    ]);
  }
}

function word(number) {
  return Number.isNaN(number) ? "nan" : number > 0 ? "inf" : "-inf";
}

// JSON in which every number reads back as the same double: -0 keeps its sign, seeds all their digits.
function json(value) {
  if (typeof value === "bigint") return String(value);
  if (typeof value === "number") return Object.is(value, -0) ? "-0.0" : JSON.stringify(value);
  if (Array.isArray(value)) return `[${value.map(json).join(", ")}]`;
  if (value === null || typeof value !== "object") return JSON.stringify(value);
  return `{${Object.entries(value)
    .map(([k, v]) => `${JSON.stringify(k)}: ${json(v)}`)
    .join(",\n ")}}`;
}
