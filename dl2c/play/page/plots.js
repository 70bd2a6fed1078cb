// Quantities over time, each in a strip of its own. uPlot (the folder uplot) draws them.

import { colour, element, say, shown } from "./elements.js";

/* global uPlot */

const HEIGHT = 112; // CSS pixels of a strip
const PLOTTED = 4; // strips of variables, where the model names none
const FONT = "11px system-ui, sans-serif";

// `series` are {label, unit, place} or {label, sums}; pressing a strip calls `seek` with a number of steps.
export class Plots {
  constructor(place, series, seek) {
    this.strips = series.map((one) => {
      const graph = element("div");
      const value = element("span");
      const label = element("span", { text: one.unit ? `${one.label} / ${one.unit}` : one.label });
      place.append(element("figure", { class: "plot" }, element("figcaption", {}, label, value), graph));
      const chart = new uPlot(optionsOf(() => this.time), [[], []], graph);
      const canvas = chart.ctx.canvas;
      canvas.setAttribute("role", "img");
      canvas.setAttribute("aria-label", `${one.label} over time`);
      chart.over.addEventListener("click", (event) => seek(this.#nearest(chart, event.offsetX)));
      return { ...one, graph, chart, valueText: value };
    });
  }

  // Draws all steps; `time` is where the player stands.
  draw(episode, time) {
    const moments = [episode.first, ...episode.steps];
    this.time = time;
    this.times = moments.map((m) => m.time);
    const points = moments.flatMap(pointsOf);
    for (const strip of this.strips) {
      const values = strip.sums ? summed(points) : points.map((p) => p.x[strip.place]);
      fitted(strip.chart, strip.graph.clientWidth);
      strip.chart.setData([points.map((p) => p.time), values.map((v) => (Number.isFinite(v) ? v : null))]);
      const now = strip.sums ? sumOf(episode.steps.slice(0, episode.at)) : episode.now.x[strip.place];
      say(strip.valueText, shown(now));
    }
  }

  // The number of steps after which the time is nearest to that of a place in a strip.
  #nearest(chart, across) {
    const pointed = chart.posToVal(across, "x");
    const distances = this.times.map((t) => Math.abs(t - pointed));
    return distances.indexOf(Math.min(...distances));
  }
}

// How a strip looks; `now` says where the player stands.
function optionsOf(now) {
  const axis = {
    font: FONT,
    stroke: () => colour("faint"),
    grid: { stroke: () => colour("line"), width: 0.5 },
    ticks: { show: false },
    values: (_, marks) => marks.map(shown),
  };
  return {
    width: 0,
    height: HEIGHT,
    legend: { show: false },
    cursor: { drag: { x: false, y: false }, y: false, sync: { key: "time" } },
    scales: { x: { time: false, range: (_, low, high) => [low ?? 0, high > low ? high : (low ?? 0) + 1] } },
    axes: [
      { ...axis, size: 22, gap: 2, space: 60 },
      { ...axis, size: 58, gap: 4, space: 26 },
    ],
    series: [{}, { stroke: () => colour("series"), width: 1.5, points: { show: false } }],
    hooks: { draw: [(chart) => markTime(chart, now())] },
  };
}

// A line where the player stands.
function markTime(chart, time) {
  const { ctx: pen, bbox } = chart;
  const across = Math.round(chart.valToPos(time ?? 0, "x", true));
  pen.fillStyle = colour("faint");
  pen.fillRect(across, bbox.top, window.devicePixelRatio || 1, bbox.height);
}

// Takes the width that there is.
function fitted(chart, width) {
  if (width > 0 && width !== chart.width) chart.setSize({ width, height: HEIGHT });
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

// What was earned until each point.
function summed(points) {
  let sum = 0;
  return points.map((p) => (sum += p.earned));
}

export function sumOf(moments) {
  return moments.reduce((sum, m) => sum + m.reward, 0);
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
