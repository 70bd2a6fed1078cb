// Time: steps as they are asked for, shown at the pace at which they happen.

const BRIEF = 1e-3; // seconds of the model: shorter steps are held a moment, so that one sees them
const HELD_FOR = 60; // milliseconds
const MOST = 8; // steps between two frames

export class Player {
  // `decide()` gives {choices, inputs} of the next step; `stepped()` is told of steps, `draw()` of frames.
  constructor(episode, { decide, stepped, draw }) {
    Object.assign(this, { episode, decide, stepped, draw, running: false, speed: 1, shown: 0, waits: 0 });
  }

  // Shows what is there, without motion.
  settle() {
    this.shown = this.episode.now.time;
    this.draw();
  }

  run(running) {
    this.running = running && !this.episode.over;
    this.#wake();
  }

  // One step, which then is shown as it happened.
  step() {
    if (this.episode.over) return;
    const { choices, inputs } = this.decide();
    this.shown = this.episode.now.time;
    this.episode.step(choices, inputs);
    this.waits = this.episode.now.duration < BRIEF ? performance.now() + HELD_FOR : 0;
    if (this.episode.over) this.running = false;
    this.stepped();
    this.#wake();
  }

  // What part of the last step is shown, from 0 to 1.
  get part() {
    const { time, duration } = this.episode.now;
    return duration > 0 ? Math.min(1, Math.max(0, 1 - (time - this.shown) / duration)) : 1;
  }

  // The state there; between two that are known, on the line between them.
  get state() {
    const { x, inside } = this.episode.now;
    if (this.part >= 1 || !inside) return x;
    const along = this.part * (inside.length - 1);
    const k = Math.floor(along);
    return inside[k].map((v, j) => v + (along - k) * (inside[k + 1][j] - v));
  }

  #wake() {
    if (this.frame) return;
    let before = performance.now();
    const next = (now) => {
      this.#advance(Math.min(now - before, 100), now);
      before = now;
      this.draw();
      this.frame = this.running || this.shown < this.episode.now.time ? requestAnimationFrame(next) : 0;
    };
    this.frame = requestAnimationFrame(next);
  }

  #advance(milliseconds, now) {
    this.shown += (milliseconds / 1000) * this.speed;
    for (
      let k = 0;
      k < MOST && this.running && this.shown >= this.episode.now.time && now >= this.waits;
      k++
    ) {
      const ahead = this.shown - this.episode.now.time;
      this.step();
      this.shown += ahead;
    }
    this.shown = Math.min(this.shown, this.episode.now.time);
  }
}
