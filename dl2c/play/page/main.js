// The page: the parts together, and what keys and buttons do.

import { clearance, conjuncts, failing, holds, written } from "./conditions.js";
import { Choices, Inputs, label } from "./controls.js";
import { Deciding } from "./deciding.js";
import { byId, element, say, shown } from "./elements.js";
import { Engine, Refused } from "./engine.js";
import { Episode } from "./episode.js";
import { listen } from "./keys.js";
import { Listing } from "./listing.js";
import { Bars, States } from "./panels.js";
import { Drivers, Policy } from "./policy.js";
import { Player } from "./player.js";
import { Plots, seriesOf, sumOf } from "./plots.js";
import { Scene } from "./scene.js";
import { endingOf, hintFor, moodOf } from "./words.js";

const KEPT = 60_000; // milliseconds for which a saved episode may be fetched
const REDRAWN = 100; // milliseconds between two pictures of the past

class Page {
  constructor(engine, facts) {
    this.facts = facts;
    this.engine = engine;
    this.episode = new Episode(engine, facts);
    this.deciding = new Deciding(engine, facts);
    this.chosen = facts.choices.map(() => 0);
    this.asked = null;
    this.player = new Player(this.episode, {
      decide: () => this.decide(),
      stepped: () => this.stepped(),
      draw: () => this.draw(),
    });
    this.#parts();
    this.#buttons();
    this.#keys();
    this.#about();
    if (this.restart(randomSeed()) && !this.episode.over) this.tell(hintFor(this.facts), "");
  }

  // What is asked for before anybody asks: the values that the variables have.
  #firstValues() {
    if (this.facts.batch.action_map === 1) return this.facts.inputs.map(() => 0);
    return this.facts.inputs.map(({ variable, low, high }) => {
      const k = this.facts.variables.findIndex((q) => q.name === variable);
      return k < 0 ? high : Math.min(Math.max(this.episode.first.x[k], low), high);
    });
  }

  #parts() {
    const { facts } = this;
    this.drivers = new Drivers(byId("policy"), {
      deciding: this.deciding,
      facts,
      policy: facts.policy && new Policy(this.engine, facts),
      changed: () => this.refresh(),
      push: (share) => this.push(share),
    });
    this.choices = new Choices(
      byId("choices"),
      facts,
      (choice, alternative) => this.choose(choice, alternative),
      (name, reason) => this.tell(`${name}: ${reason}`, "bad"),
    );
    this.inputs = new Inputs(byId("inputs"), facts, (k, value) => this.ask(k, value));
    this.bars = new Bars(byId("bars"), facts);
    this.states = new States(byId("values"), facts, {
      begin: (state) => this.restart(this.episode.start.seed, state),
      check: (state) => this.against(state),
      seed: (text) => this.seed(text),
    });
    this.listing = new Listing(byId("listing"), facts.source.text);
    this.scene = new Scene(byId("scene"), facts, this.engine);
    this.plots = new Plots(byId("plots"), seriesOf(facts), (count) => this.seek(count));
  }

  #buttons() {
    const on = (id, event, call) => byId(id).addEventListener(event, call);
    on("run", "click", () => this.run(!this.player.running));
    on("step", "click", () => this.once());
    on("back", "click", () => this.seek(this.episode.at - 1));
    on("restart", "click", () => this.again());
    on("resample", "click", () => this.restart(randomSeed()));
    on("speed", "change", (event) => {
      this.player.speed = Number(event.target.value);
    });
    on("timeline", "input", (event) => this.seek(Number(event.target.value)));
    on("record", "click", () => this.save());
    addEventListener("resize", () => this.draw(true));
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw(true));
  }

  #keys() {
    const does = {
      " ": () => this.run(!this.player.running),
      ArrowRight: () => this.once(),
      ArrowLeft: () => this.seek(this.episode.at - 1),
      ArrowUp: () => this.inputs.nudge(5, this.asked),
      ArrowDown: () => this.inputs.nudge(-5, this.asked),
      r: () => this.again(),
      n: () => this.restart(randomSeed()),
    };
    for (let k = 1; k <= 9; k++) does[k] = () => this.choices.press(k - 1);
    listen(does, () => byId("keys").checked);
  }

  #about() {
    const { facts } = this;
    const { known } = facts.theorem;
    byId("claim").textContent = `dl2c ${facts.version}, ${facts.source.name}; its theorem: ${known}`;
    byId("notes").append(...facts.notes.map((text) => element("p", { class: "note", text })));
    if (facts.approximate) {
      byId("replay-note").textContent =
        "Functions such as sin round in other ways elsewhere: " +
        "`dl2c replay` checks every step from the state before it, within 1e-12.";
    }
  }

  // What is asked for where the episode stands, by the policy or by hand.
  get request() {
    return this.drivers.asks(this.episode.now, { choices: this.chosen, inputs: this.asked });
  }

  // What the next step tries.
  decide() {
    const { choices, inputs, said } = this.drivers.decided(this.episode.now, this.request);
    this.taken = said;
    return { choices, inputs };
  }

  // Moves every variable that has bounds at random, by no more than a share of its range, and not out of it.
  push(share) {
    if (this.episode.over) return;
    const moved = this.facts.variables.map(({ low, high }, k) => {
      const value = this.episode.now.x[k];
      if (low === null || high === null) return value;
      const next = value + share * (high - low) * (2 * Math.random() - 1);
      return Math.min(Math.max(next, Math.min(low, value)), Math.max(high, value));
    });
    this.player.running = false;
    this.episode.disturb(moved);
    this.player.settle();
    this.refresh();
    this.tell("The state was pushed: a recording ends before that.", "");
  }

  choose(choice, alternative) {
    this.chosen[choice] = alternative;
    if (!this.player.running && this.chosen.length === 1 && !this.episode.over) this.once();
    else this.controls();
    return true;
  }

  ask(k, value) {
    this.asked[k] = value;
    this.controls();
    this.margins();
    return true;
  }

  run(running) {
    if (running && this.episode.over) this.again();
    this.player.run(running);
    this.transport();
    return true;
  }

  once() {
    this.player.running = false;
    if (this.episode.over) this.tell(`${this.ending()}. Restart, or go back.`, this.mood());
    else this.guarded(() => this.player.step());
    this.refresh();
    return true;
  }

  seek(count) {
    this.player.running = false;
    this.episode.seek(count);
    this.player.settle();
    this.refresh();
    return true;
  }

  // The same beginning once more.
  again() {
    return this.restart(this.episode.start.seed, this.episode.start.state);
  }

  // Begins with a seed, in a given state or a drawn one.
  restart(seed, state = null) {
    this.player.running = false;
    const begun = this.guarded(() => this.episode.begin(seed, state));
    const nowhere = !begun && !this.episode.first;
    if (nowhere) this.episode.beginNowhere(seed);
    this.asked ??= this.#firstValues();
    this.scene.begin(this.episode.first);
    if (begun || nowhere) {
      const { x, p } = this.episode.first;
      this.states.began(state ? this.episode.arrays(state).flat() : [...x, ...p], seed);
    }
    if (begun) this.tell("", "");
    this.chosen = this.chosen.map((c, k) => this.#possible(c, k));
    this.player.settle();
    this.refresh();
    return true;
  }

  // An alternative of a choice that has a run here, that one if it has.
  #possible(alternative, choice) {
    const first = this.deciding.firstOf[choice];
    const open = this.facts.choices[choice].alternatives.map((_, a) => this.episode.now.mask[first + a]);
    return open[alternative] ? alternative : Math.max(0, open.indexOf(true));
  }

  seed(text) {
    const digits = /^\d{1,20}$/.test(text.trim()) ? BigInt(text.trim()) : null;
    if (digits === null || digits >= 2n ** 64n) this.tell("A seed is a whole number below 2^64.", "bad");
    else this.restart(digits);
  }

  // Does something that the model may refuse; whether it did.
  guarded(does) {
    try {
      does();
      return true;
    } catch (problem) {
      if (!(problem instanceof Refused)) throw problem;
      this.player.running = false;
      this.tell(`${problem.message[0].toUpperCase()}${problem.message.slice(1)}.`, "bad");
      return false;
    }
  }

  // What stands against beginning in a state; "" where nothing does.
  against(state) {
    const [x, p] = this.episode.arrays(state);
    if (![...x, ...p].every(Number.isFinite)) return "Every field needs a number.";
    const tree = this.deciding.condition("assumption", "");
    const { margin, truth } = this.engine.atoms(x, p, this.deciding.valuesOf(this.asked));
    const wrong = failing(tree, truth).map((k) => this.#fails(k, margin));
    return wrong.length > 0 ? `Not an initial state: ${wrong.join("; ")}.` : "";
  }

  #fails(k, margin) {
    const atom = this.facts.atoms[k];
    const by = Math.abs(clearance(atom, margin[k]));
    return `${written(k, this.facts.atoms)} fails${Number.isFinite(by) && by > 0 ? ` by ${shown(by)}` : ""}`;
  }

  stepped() {
    const { now } = this.episode;
    if (now.ended) this.tell(`${this.ending()}.`, this.mood());
    else if (this.taken) this.tell(this.taken, "bad");
    else if (now.blocked) this.tell(`Blocked, so this ran instead: ${this.#ran(now)}`, "bad");
    else this.tell("", "");
    this.stale = true;
  }

  #ran(moment) {
    const texts = this.facts.choices.map((c, k) => c.alternatives[moment.executedChoices[k]]);
    return texts.filter(Boolean).map(label).join(", ") || "another run";
  }

  ending() {
    return endingOf(this.facts, this.episode.now, (kind, name) =>
      holds(this.deciding.condition(kind, name), this.#atoms().truth),
    );
  }

  mood() {
    return moodOf(this.facts, this.episode.now);
  }

  tell(text, mood) {
    const status = byId("status");
    say(status, text);
    status.className = mood;
  }

  #atoms(moment = this.episode.now) {
    return this.engine.atoms(moment.x, moment.p, this.deciding.valuesOf(this.asked));
  }

  // A frame: the scene where the time stands; the rest where something has changed.
  draw(all = false) {
    if (this.stale || all) this.refresh();
    this.scene.draw(this.episode, this.player.state, this.player.part);
    const now = performance.now();
    if (all || !this.player.running || now - (this.drawn ?? 0) > REDRAWN) {
      this.plots.draw(this.episode, this.player.shown);
      this.drawn = now;
    }
    this.transport();
  }

  refresh() {
    this.stale = false;
    this.controls();
    this.margins();
    const { now } = this.episode;
    this.states.now([...now.x, ...now.p]);
    this.transport();
  }

  transport() {
    const { player, episode } = this;
    const { now, at } = episode;
    say(byId("run"), player.running ? "Pause" : "Run");
    const timeline = byId("timeline");
    timeline.max = episode.steps.length;
    timeline.value = at;
    const total = sumOf(episode.steps.slice(0, at));
    const parts = [
      `step ${at}`,
      `time ${player.shown.toFixed(2)} s`,
      `reward ${shown(now.reward)}`,
      `return ${shown(total)}`,
    ];
    const numbers = byId("numbers");
    parts.forEach((text, k) => say(numbers.children[k] ?? numbers.appendChild(element("span")), text));
  }

  controls() {
    const { now } = this.episode;
    this.guilty = new Set();
    const { choices, inputs, shares } = this.request;
    this.choices.show(choices, (c, a) => this.#reason(c, a, now), shares);
    this.inputs.show(inputs, (k) => this.deciding.intervals(k, choices, now, inputs));
    this.marks();
  }

  #reason(choice, alternative, now) {
    const found = now.ended ? null : this.deciding.against(choice, alternative, now, this.asked);
    if (found === null) return null;
    found.forEach((test) => test.guilty.forEach((k) => this.guilty.add(k)));
    const texts = found.map(
      ({ tree, by }) =>
        `${written(tree, this.facts.atoms)} fails${Number.isFinite(by) ? ` by ${shown(-by)}` : ""}`,
    );
    if (texts.length === 0) return Array(2).fill("every run that begins like this fails later");
    return [texts[0] + (texts.length > 1 ? ` (and ${texts.length - 1} more)` : ""), texts.join("; ")];
  }

  margins() {
    const { facts, deciding } = this;
    const { margin, truth } = this.#atoms();
    const of = (kind) => facts.conditions.filter((c) => c.kind === kind);
    const trees = (kind) =>
      of(kind)
        .flatMap((c) => conjuncts(c.tree))
        .filter((t) => typeof t !== "boolean");
    this.bars.show(
      [
        ["Safety", trees("safety")],
        ["Goals", [...trees("progress"), ...trees("stability")]],
        ["Tests before a step", deciding.guards()],
        ["Tests of what is asked for", deciding.testsFor(this.chosen, this.episode.now, this.asked)],
        ["Domain of the motion", trees("domain")],
      ],
      margin,
      truth,
    );
  }

  // Marks in the text what ran and what does not hold.
  marks() {
    const { facts, episode } = this;
    const ran = (episode.now.paths ?? []).flatMap((k) => facts.paths[k].statements).filter(Boolean);
    const { truth } = this.#atoms();
    const wrong = facts.conditions.filter((c) => c.kind === "safety").flatMap((c) => failing(c.tree, truth));
    const broken = [...wrong, ...(this.guilty ?? [])].map((k) => facts.atoms[k].span).filter(Boolean);
    this.listing.mark(ran, broken);
  }

  save() {
    const blob = new Blob([this.episode.recording()], { type: "application/json" });
    const url = URL.createObjectURL(blob);
    const name = this.facts.name.replace(/[^A-Za-z0-9]+/g, "_");
    element("a", { href: url, download: `${name}-${this.episode.start.seed}.json` }).click();
    setTimeout(() => URL.revokeObjectURL(url), KEPT);
  }
}

function randomSeed() {
  return BigInt(crypto.getRandomValues(new Uint32Array(1))[0]);
}

async function main() {
  const facts = JSON.parse(byId("facts").textContent);
  const module = Uint8Array.from(atob(byId("module").textContent), (c) => c.charCodeAt(0));
  window.page = new Page(await Engine.start(module, facts.batch, facts.policy?.outputs), facts);
  document.documentElement.dataset.ready = "true";
}

main();
