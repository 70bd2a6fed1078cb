// The scene of a model: where things are, as its manifest says, and the ways that they took.

import { colour, element, shown } from "./elements.js";
import { GRID } from "./engine.js";
import { argumentsOf, heightOf, limitsOf, panelsOf } from "./layout.js";
import { Painter, dialOf, groundOf } from "./shapes.js";

export class Scene {
  // Nothing is drawn of a model without a scene.
  constructor(place, facts, engine) {
    Object.assign(this, { scene: facts.scene, engine });
    if (this.scene.shapes.length === 0) return;
    this.shaded = this.scene.shaded.map((name) => facts.variables.findIndex((q) => q.name === name));
    this.canvas = element("canvas", { role: "img" });
    this.said = element("figcaption", { class: "note" });
    place.append(this.canvas, this.said);
  }

  // An episode begins in a state: the limits stay for all of it.
  begin({ x, p }) {
    if (this.canvas) this.limits = limitsOf(this.scene, this.engine.scene(x, p));
  }

  // The picture of a state; `part` of the last step is shown.
  draw(episode, x, part) {
    if (!this.canvas) return;
    this.canvas.style.height = `${heightOf(this.scene, this.canvas.clientWidth)}px`;
    const { pen, width, height } = penOf(this.canvas);
    const { p } = episode.now;
    const values = this.engine.scene(x, p);
    const panels = panelsOf(this.scene, this.limits, width, height);
    this.#background(pen, panels, x, p);
    if (panels.plane) this.#ways(pen, panels.plane, episode, part, values);
    const painter = new Painter(pen, panels);
    for (const shape of this.scene.shapes) painter.draw(shape, argumentsOf(shape, values));
    painter.label(width, height);
    this.#say(values);
  }

  #say(values) {
    const texts = this.scene.shapes
      .filter((s) => s.panel === "text")
      .map((s) => `${s.name} ${shown(argumentsOf(s, values).value[0])} ${s.unit}`.trim());
    this.said.textContent = texts.join(", ");
    const places = this.scene.shapes
      .filter((s) => s.name && s.panel !== "text")
      .map((s) => {
        const given = Object.values(argumentsOf(s, values)).flat().slice(0, 2);
        return `${s.name} ${given.map(shown).join(", ")}`;
      });
    this.canvas.setAttribute("aria-label", `Scene: ${[...places, ...texts].join("; ")}`);
  }

  // The ways of agents in the plane, through the states inside of steps.
  #ways(pen, panel, episode, part, values) {
    const agents = this.scene.shapes.filter(
      (s) => s.role === "agent" && s.arguments.x && s.panel === "plane",
    );
    if (agents.length === 0) return;
    const steps = episode.steps.slice(0, episode.at);
    const ways = steps.map((m) => (m.way ??= this.#wayOf(m)));
    if (part < 1 && ways.length > 0) {
      const last = ways.pop();
      ways.push(last.slice(0, 1 + Math.floor(part * (last.length - 1))));
    }
    const points = [this.engine.scene(episode.first.x, episode.now.p), ...ways.flat(), values];
    pen.save();
    pen.beginPath();
    pen.rect(panel.left, panel.top, panel.width, panel.height);
    pen.clip();
    for (const {
      arguments: { x, y },
    } of agents) {
      pen.strokeStyle = colour("agent");
      pen.lineWidth = 1.5;
      pen.beginPath();
      points.forEach((v) => pen.lineTo(panel.x.at(v[x[0]]), panel.y.at(v[y[0]])));
      pen.stroke();
    }
    pen.restore();
  }

  #wayOf(moment) {
    return moment.inside.map((x) => this.engine.scene(x, moment.p));
  }

  #background(pen, panels, x, p) {
    pen.font = "11px system-ui, sans-serif";
    pen.textBaseline = "alphabetic";
    if (panels.plane) this.#plane(pen, panels.plane, x, p);
    if (panels.line) this.#road(pen, panels.line);
    if (panels.level) this.#upwards(pen, panels.level, "level");
    if (panels.dial) {
      const { left, top, width, height } = panels.dial;
      pen.strokeStyle = colour("line");
      pen.beginPath();
      pen.arc(left + width / 2, top + height / 2, dialOf(panels.dial), 0, 7);
      pen.stroke();
    }
  }

  #plane(pen, panel, x, p) {
    pen.strokeStyle = colour("track");
    pen.lineWidth = 1;
    pen.beginPath();
    for (const [at] of panel.x.ticks()) {
      pen.moveTo(at, panel.top);
      pen.lineTo(at, panel.top + panel.height);
    }
    for (const [at] of panel.y.ticks()) {
      pen.moveTo(panel.left, at);
      pen.lineTo(panel.left + panel.width, at);
    }
    pen.stroke();
    if (this.shaded.length === 2) this.#shade(pen, panel, x, p);
    pen.strokeStyle = colour("line");
    pen.strokeRect(panel.left, panel.top, panel.width, panel.height);
    this.#across(pen, panel, "x");
    this.#upwards(pen, panel, "y");
  }

  // Marks where @safety fails, all else being as it is.
  #shade(pen, panel, x, p) {
    const between = ({ low, high }, n) =>
      Array.from({ length: n }, (_, k) => low + ((high - low) * (k + 0.5)) / n);
    const [columns, rows] = [between(panel.x, GRID[0]), between(panel.y, GRID[1])];
    const unsafe = this.engine.unsafe(x, p, this.shaded, columns, rows);
    const [wide, high] = [panel.width / GRID[0], panel.height / GRID[1]];
    pen.fillStyle = colour("unsafe");
    pen.globalAlpha = 0.25;
    columns.forEach((a, i) =>
      rows.forEach((b, j) => {
        if (unsafe[i * rows.length + j])
          pen.fillRect(panel.x.at(a) - wide / 2, panel.y.at(b) - high / 2, wide + 0.5, high + 0.5);
      }),
    );
    pen.globalAlpha = 1;
  }

  #road(pen, panel) {
    const ground = groundOf(panel);
    pen.fillStyle = colour("track");
    pen.fillRect(panel.left, ground - 52, panel.width, 52);
    this.#across(pen, panel, "line");
  }

  // Numbers and unit below a panel.
  #across(pen, panel, axis) {
    const below = panel.top + panel.height;
    pen.fillStyle = colour("faint");
    pen.textAlign = "center";
    for (const [at, text] of panel[axis].ticks()) pen.fillText(text, at, below + 14);
    pen.textAlign = "right";
    pen.fillText(this.#unit(axis, axis === "x" ? "x" : ""), panel.left + panel.width, below + 28);
    pen.textAlign = "left";
  }

  // Numbers and unit to the left of a panel.
  #upwards(pen, panel, axis) {
    pen.fillStyle = colour("faint");
    pen.textAlign = "right";
    for (const [at, text] of panel[axis].ticks()) pen.fillText(text, panel.left - 6, at + 4);
    pen.textAlign = "left";
    pen.fillText(
      this.#unit(axis, axis === "y" ? "y" : ""),
      Math.max(2, panel.left - 40),
      panel.top + panel.height + 14,
    );
  }

  #unit(axis, name) {
    return [name, this.scene.axes[axis].unit].filter(Boolean).join(" / ");
  }
}

// What draws on a canvas that is as sharp as the screen, cleared; sizes are CSS pixels.
function penOf(canvas) {
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
