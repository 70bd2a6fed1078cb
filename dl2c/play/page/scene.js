// Where things are: the variables that a model plots against each other, in a plane.

import { colour, element } from "./elements.js";
import { penOf } from "./plots.js";

const EDGE = 24;

export class Scene {
  // Nothing is drawn of a model that plots no pairs.
  constructor(place, facts) {
    const plotted = facts.variables.map((q, k) => ({ ...q, k })).filter((q) => q.plot === "scatter");
    this.pairs = plotted.flatMap((q, k) => (k % 2 === 0 && plotted[k + 1] ? [[q, plotted[k + 1]]] : []));
    if (this.pairs.length === 0) return;
    this.canvas = element("canvas", { role: "img", "aria-label": "Positions in the plane" });
    this.canvas.style.aspectRatio = "16 / 10";
    place.append(this.canvas);
  }

  draw(episode, state) {
    if (!this.canvas) return;
    const { pen, width, height } = penOf(this.canvas);
    const moments = [episode.first, ...episode.steps.slice(0, episode.at)].map((m) => m.x);
    const view = this.#view(moments, width, height);
    this.pairs.forEach(([q, r], k) => {
      const at = (x) => [view.x(x[q.k]), view.y(x[r.k])];
      pen.strokeStyle = pen.fillStyle = colour(["series", "bad", "good"][k % 3]);
      pen.beginPath();
      moments.forEach((x) => pen.lineTo(...at(x)));
      pen.stroke();
      pen.beginPath();
      pen.arc(...at(state), 6, 0, 7);
      pen.fill();
      pen.font = "12px system-ui, sans-serif";
      const [left, top] = at(state);
      pen.fillText(q.description || q.name, left + 9, top - 6);
    });
  }

  #view(moments, width, height) {
    const along = (index) => {
      const values = this.pairs.flatMap((pair) => [pair[index].low, pair[index].high,
        ...moments.map((x) => x[pair[index].k])]).filter((v) => v !== null);
      return [Math.min(...values), Math.max(...values)];
    };
    const [[left, right], [bottom, top]] = [along(0), along(1)];
    const scale = Math.min((width - 2 * EDGE) / (right - left || 1), (height - 2 * EDGE) / (top - bottom || 1));
    return {
      x: (v) => width / 2 + (v - (left + right) / 2) * scale,
      y: (v) => height / 2 - (v - (bottom + top) / 2) * scale,
    };
  }
}
