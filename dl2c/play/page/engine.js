// The compiled model: one environment in a WebAssembly module, by the calls of dl2c.h.

const OK = 0;

// States inside a step that are shown: enough for curves to look round.
const INSIDE = 9;

// Places of a plane at which @safety is judged, where that is shaded.
export const GRID = [40, 30];

// The buffers of dl2c.h in its order: name, type, and how many entries by the sizes of the model.
const BUFFERS = [
  ["choices", Int32Array, (s) => s.nchoice],
  ["inputs", Float64Array, (s) => s.ninput],
  ["obs", null, (s) => s.nobs],
  ["final_obs", null, (s) => s.nobs],
  ["rewards", Float64Array, () => 1],
  ["terminated", Uint8Array, () => 1],
  ["truncated", Uint8Array, () => 1],
  ["mask", Int8Array, (s) => s.nmask],
  ["executed_choices", Int32Array, (s) => s.nchoice],
  ["executed_inputs", Float64Array, (s) => s.ninput],
  ["drawn_choices", Int32Array, (s) => s.nenvchoice],
  ["drawn_inputs", Float64Array, (s) => s.nenvinput],
  ["status", Int32Array, () => 1],
  ["reason", Int32Array, () => 1],
  ["cost", Int32Array, () => 1],
  ["blocked", Uint8Array, () => 1],
  ["postcondition", Uint8Array, () => 1],
  ["saturated", Uint8Array, () => 1],
  ["reset", Uint8Array, () => 1],
  ["duration", Float64Array, () => 1],
  ["time", Float64Array, () => 1],
];

const SIZES = [
  "nx",
  "np",
  "nobs",
  "nchoice",
  "ninput",
  "nenvchoice",
  "nenvinput",
  "nmask",
  "npred",
  "nflow",
  "nroot",
  "obs_size",
  "snapshot_size",
  "nscene",
];
const MORE_SIZES = ["natom", "nu", "npiece", "nnoted"];

// What the model refuses: the message says why.
export class Refused extends Error {}

export class Engine {
  // `options` are those of dl2c_options by name; `outputs` is how many numbers the policy gives, if any.
  static async start(bytes, options, outputs = 0) {
    const { instance } = await WebAssembly.instantiate(bytes, {});
    instance.exports._initialize();
    return new Engine(instance.exports, options, outputs);
  }

  constructor(calls, options, outputs) {
    this.calls = calls;
    this.options = options;
    this.sizes = {
      ...this.#read("dl2c_model_sizes", SIZES),
      ...this.#read("dl2c_sizes_of_conditions", MORE_SIZES),
    };
    this.places = {};
    const table = this.#reserve(4 * BUFFERS.length);
    BUFFERS.forEach(([name, type, count], k) => {
      const own = type ?? (this.sizes.obs_size === 4 ? Float32Array : Float64Array);
      this.#array(name, own, count(this.sizes));
      new Uint32Array(calls.memory.buffer, table, BUFFERS.length)[k] = this.places[name].at;
    });
    for (const [name, count] of [
      ["x", this.sizes.nx],
      ["p", this.sizes.np],
      ["u", this.sizes.nu],
      ["scene", this.sizes.nscene],
      ["fractions", INSIDE],
      ["inside", INSIDE * this.sizes.nx],
      ["grid", GRID[0] * GRID[1] * this.sizes.nx],
      ["margin", this.sizes.natom],
      ["low", this.sizes.npiece],
      ["high", this.sizes.npiece],
    ])
      this.#array(name, Float64Array, count);
    this.#array("given", Uint8Array, this.sizes.nu);
    this.#array("truth", Uint8Array, this.sizes.natom);
    if (calls.dl2c_policy_outputs) {
      this.#array("observation", Float64Array, this.sizes.nobs);
      this.#array("outputs", Float64Array, outputs);
    }
    this.#array("violated", Int32Array, GRID[0] * GRID[1]);
    this.#array("noted", Int32Array, this.sizes.nnoted);
    this.#array("seed", BigUint64Array, 1);
    this.#array("snapshot", Uint8Array, this.sizes.snapshot_size);
    this.batch = this.#create(table);
  }

  // A view of a buffer, valid until the next call that takes memory.
  view(name) {
    const { at, type, count } = this.places[name];
    return new type(this.calls.memory.buffer, at, count);
  }

  reset(seed) {
    this.view("seed")[0] = seed;
    this.#check(this.calls.dl2c_batch_reset(this.batch, 0, this.places.seed.at));
  }

  // Begins in a state; throws Refused where the assumptions do not hold there.
  resetTo(seed, x, p) {
    this.view("seed")[0] = seed;
    this.#place(x, p);
    const at = this.places;
    this.#check(this.calls.dl2c_batch_reset_to(this.batch, 0n, at.seed.at, at.x.at, at.p.at));
  }

  // Which paths a step with these decisions will take, in order.
  pathsAhead(choices, inputs) {
    this.#request(choices, inputs);
    const count = this.calls.dl2c_paths_ahead(this.batch, 0n, this.places.noted.at);
    return [...this.view("noted").slice(0, Math.max(0, count))];
  }

  // One step; what it led to is in `result` and `state`.
  step(choices, inputs) {
    this.#request(choices, inputs);
    this.#check(this.calls.dl2c_batch_step(this.batch));
  }

  result() {
    const first = (name) => this.view(name)[0];
    return {
      reward: first("rewards"),
      ended: Boolean(first("terminated") || first("truncated")),
      status: first("status"),
      reason: first("reason"),
      cost: first("cost"),
      blocked: Boolean(first("blocked")),
      postcondition: Boolean(first("postcondition")),
      duration: first("duration"),
      time: first("time"),
      executedChoices: [...this.view("executed_choices")],
      executedInputs: [...this.view("executed_inputs")],
      drawnChoices: [...this.view("drawn_choices")],
      drawnInputs: [...this.view("drawn_inputs")],
    };
  }

  mask() {
    return [...this.view("mask")].map(Boolean);
  }

  state() {
    const { x, p } = this.places;
    this.#check(this.calls.dl2c_batch_get_state(this.batch, 0n, x.at, p.at));
    return { x: [...this.view("x")], p: [...this.view("p")] };
  }

  // Overwrites the state in the middle of an episode.
  setState(x, p) {
    this.#place(x, p);
    this.#check(this.calls.dl2c_batch_set_state(this.batch, 0n, this.places.x.at, this.places.p.at));
  }

  save() {
    this.#check(this.calls.dl2c_batch_save(this.batch, 0n, this.places.snapshot.at));
    return this.view("snapshot").slice();
  }

  restore(snapshot) {
    this.view("snapshot").set(snapshot);
    this.#check(this.calls.dl2c_batch_restore(this.batch, 0n, this.places.snapshot.at));
  }

  // Margin and truth of every comparison in a state, with these values of inputs.
  atoms(x, p, u) {
    this.#place(x, p);
    this.view("u").set(u);
    const at = this.places;
    this.calls.dl2c_atoms(at.x.at, at.p.at, at.u.at, at.margin.at, at.truth.at);
    return { margin: [...this.view("margin")], truth: [...this.view("truth")].map(Boolean) };
  }

  // Closed intervals of the values that an input may take on a path; `given` are inputs with a value in u.
  admissible(path, place, x, p, given, u) {
    this.#place(x, p);
    this.view("u").set(u);
    this.view("given").set(given.map(Number));
    const at = this.places;
    const count = this.calls.dl2c_admissible_values(
      path,
      place,
      at.x.at,
      at.p.at,
      at.given.at,
      at.u.at,
      at.low.at,
      at.high.at,
    );
    const [low, high] = [this.view("low"), this.view("high")];
    return Array.from({ length: Math.max(0, count) }, (_, k) => [low[k], high[k]]);
  }

  // States inside the last step, at equal distances in time from where its first flow began to where its last
  // ended: INSIDE of them.
  inside() {
    this.view("fractions").set(Array.from({ length: INSIDE }, (_, k) => k / (INSIDE - 1)));
    const { fractions, inside } = this.places;
    this.#check(this.calls.dl2c_inspect_motion(this.batch, 0n, BigInt(INSIDE), fractions.at, inside.at));
    const all = this.view("inside");
    return Array.from({ length: INSIDE }, (_, k) => [
      ...all.subarray(k * this.sizes.nx, (k + 1) * this.sizes.nx),
    ]);
  }

  // What the model's scene shows of a state.
  scene(x, p) {
    this.#place(x, p);
    const at = this.places;
    this.#check(this.calls.dl2c_scene_values(at.x.at, at.p.at, at.scene.at));
    return [...this.view("scene")];
  }

  // Whether @safety fails where two variables, by their places, have values of a grid, all else as it is.
  unsafe(x, p, [first, second], columns, rows) {
    this.#place(x, p);
    const grid = this.view("grid");
    columns.forEach((a, i) =>
      rows.forEach((b, j) => {
        const at = (i * rows.length + j) * x.length;
        grid.set(x, at);
        grid[at + first] = a;
        grid[at + second] = b;
      }),
    );
    const count = BigInt(columns.length * rows.length);
    const { grid: states, p: constants, violated } = this.places;
    this.#check(this.calls.dl2c_inspect_violations(count, states.at, constants.at, violated.at));
    return [...this.view("violated")].map((n) => n > 0);
  }

  // What the policy makes of what it observes now.
  policyOutputs() {
    this.view("observation").set(this.view("obs"));
    this.calls.dl2c_policy_outputs(this.places.observation.at, this.places.outputs.at);
    return [...this.view("outputs")];
  }

  #request(choices, inputs) {
    this.view("choices").set(choices);
    this.view("inputs").set(inputs);
  }

  #place(x, p) {
    this.view("x").set(x);
    this.view("p").set(p);
  }

  #create(buffers) {
    const { calls, options } = this;
    const at = this.#reserve(40);
    const memory = new DataView(calls.memory.buffer);
    memory.setBigInt64(at, BigInt(options.max_steps), true);
    memory.setBigInt64(at + 8, BigInt(options.stall_limit), true);
    memory.setFloat64(at + 16, options.blocked_penalty, true);
    [0, options.on_blocked, options.action_map, 0].forEach((v, k) =>
      memory.setInt32(at + 24 + 4 * k, v, true),
    );
    const out = this.#reserve(4);
    this.#check(calls.dl2c_batch_create(1n, at, buffers, out));
    return new Uint32Array(calls.memory.buffer, out, 1)[0];
  }

  #read(call, names) {
    const at = this.#reserve(4 * names.length);
    this.calls[call](at);
    const values = new Int32Array(this.calls.memory.buffer, at, names.length);
    return Object.fromEntries(names.map((name, k) => [name, values[k]]));
  }

  #array(name, type, count) {
    this.places[name] = { at: this.#reserve(type.BYTES_PER_ELEMENT * count), type, count };
  }

  #reserve(bytes) {
    const at = this.calls.dl2c_memory(bytes);
    if (at === 0) throw new Refused("out of memory");
    return at;
  }

  #check(status) {
    if (status !== OK) throw new Refused(this.#text(this.calls.dl2c_status_text(status)));
  }

  #text(at) {
    const bytes = new Uint8Array(this.calls.memory.buffer, at);
    return String.fromCharCode(...bytes.subarray(0, bytes.indexOf(0)));
  }
}
