// Quantities over time, each in a strip of its own, on canvases.

import { colour, element, say, shown } from "./elements.js";

const MARGIN = 8;
const PLOTTED = 4; // strips of variables, where the model names none

// `series` are {label, unit, value(moment)}; pressing a strip calls `seek` with a number of steps.
export class Plots {
  constructor(place, series, seek) {
    this.strips = series.map((one) => {
      const canvas = element("canvas", { role: "img", "aria-label": `${one.label} over time` });
      const value = element("span");
      const label = element("span", { text: one.unit ? `${one.label} / ${one.unit}` : one.label });
      place.append(element("figure", { class: "plot" }, element("figcaption", {}, label, value), canvas));
      canvas.addEventListener("click", (event) => this.#press(canvas, event.offsetX, seek));
      return { ...one, canvas, valueText: value };
    });
  }

  // Draws all steps; `time` is where the cursor stands.
  draw(episode, time) {
    const moments = [episode.first, ...episode.steps];
    this.times = moments.map((m) => m.time);
    this.last = Math.max(this.times.at(-1), 1e-9);
    const points = moments.flatMap(pointsOf);
    for (const strip of this.strips) {
      const values = strip.sums ? points.map((p) => p.earned) : points.map((p) => p.x[strip.place]);
      this.#strip(strip.canvas, points, strip.sums ? summed(values) : values, time);
      const now = strip.sums ? sumOf(episode.steps.slice(0, episode.at)) : episode.now.x[strip.place];
      const [low, high] = [Math.min(...values), Math.max(...values)];
      const between = low < high && !strip.sums ? ` (${shown(low)} to ${shown(high)})` : "";
      say(strip.valueText, `${shown(now)}${between}`);
    }
  }

  #strip(canvas, points, values, time) {
    const { pen, width, height } = penOf(canvas);
    const low = Math.min(...values);
    const high = Math.max(...values);
    const across = (t) => MARGIN + (t / this.last) * (width - 2 * MARGIN);
    const up = (v) =>
      high > low ? height - MARGIN - ((v - low) / (high - low)) * (height - 2 * MARGIN) : height / 2;
    if (low < 0 && high > 0) rule(pen, [0, up(0)], [width, up(0)], colour("line"));
    pen.strokeStyle = colour("series");
    pen.lineWidth = 1.5;
    pen.beginPath();
    values.forEach((v, k) => pen.lineTo(across(points[k].time), up(v)));
    pen.stroke();
    rule(pen, [across(time), 0], [across(time), height], colour("faint"));
  }

  #press(canvas, x, seek) {
    const time = ((x - MARGIN) / (canvas.clientWidth - 2 * MARGIN)) * this.last;
    const distances = this.times.map((t) => Math.abs(t - time));
    seek(distances.indexOf(Math.min(...distances)));
  }
}

// The states of a step in time: those inside it, where it is known what they were.
function pointsOf(moment) {
  const { x, time, duration, inside, reward } = moment;
  if (!inside) return [{ time, x, earned: 0 }];
  const begun = time - duration;
  return inside.map((state, k) => ({
    time: begun + (duration * k) / (inside.length - 1),
    x: state,
    earned: k === inside.length - 1 ? reward : 0,
  }));
}

function summed(values) {
  let sum = 0;
  return values.map((v) => (sum += v));
}

export function sumOf(moments) {
  return moments.reduce((sum, m) => sum + m.reward, 0);
}

function rule(pen, from, to, style) {
  pen.strokeStyle = style;
  pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(...from);
  pen.lineTo(...to);
  pen.stroke();
}

// What draws on a canvas that is as sharp as the screen, cleared; sizes are CSS pixels.
export function penOf(canvas) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  const scale = window.devicePixelRatio || 1;
  if (canvas.width !== Math.round(width * scale) || canvas.height !== Math.round(height * scale)) {
    canvas.width = Math.round(width * scale);
    canvas.height = Math.round(height * scale);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(scale, 0, 0, scale, 0, 0);
  pen.clearRect(0, 0, width, height);
  return { pen, width, height };
}

// What is plotted over time: variables that the model marks, else the first ones; then what was earned.
export function seriesOf(facts) {
  const all = facts.variables.map((q, place) => ({ q, place }));
  const marked = all.filter(({ q }) => q.plot === "line");
  const named = (marked.length > 0 ? marked : all.slice(0, PLOTTED)).map(({ q, place }) => ({
    label: q.description ? `${q.name}: ${q.description}` : q.name,
    unit: q.unit,
    place,
  }));
  return [...named, { label: "return", unit: "", sums: true }];
}
