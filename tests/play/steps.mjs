// steps.mjs FACTS WASM STEPS OUT: takes steps with decisions that look random, in the engine of a page.
//
// Writes a row of doubles for every reset and step: 0 or 1 for a step, choices, inputs, state, constants,
// mask, reason, status, blocked, reward. Every reset has the next seed.

import { readFileSync, writeFileSync } from "node:fs";
import { Engine } from "../../dl2c/play/page/engine.js";

const [, , factsFile, moduleFile, steps, out] = process.argv;
const facts = JSON.parse(readFileSync(factsFile, "utf8"));
const engine = await Engine.start(readFileSync(moduleFile), facts.batch);

let state = 1;
function random() {
  state = (Math.imul(state, 1664525) + 1013904223) >>> 0;
  return state / 2 ** 32;
}

const rows = [];
function note(stepped, choices, inputs) {
  const { x, p } = engine.state();
  const { reason, status, blocked, reward } = engine.result();
  rows.push(stepped, ...choices, ...inputs, ...x, ...p, ...engine.mask().map(Number));
  rows.push(reason, status, Number(blocked), reward);
}

const nothing = [facts.choices.map(() => 0), facts.inputs.map(() => 0)];
let seed = 0n;
let over = true;
for (let k = 0; k < Number(steps); k++) {
  if (over) {
    engine.reset(seed++);
    note(0, ...nothing);
    over = false;
    continue;
  }
  const choices = facts.choices.map((c) => Math.floor(random() * c.alternatives.length));
  const inputs = facts.inputs.map(({ low, high }) => low + (high - low) * random());
  engine.step(choices, inputs);
  note(1, choices, inputs);
  over = engine.result().ended;
}
writeFileSync(out, new Float64Array(rows));
