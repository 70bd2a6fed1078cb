// The shapes of a scene on a canvas.

import { colour } from "./elements.js";

const MARK = 7; // radius of a point in pixels
const CAR = 28; // height of what moves on a line
const WALL = 52; // and of what stands there
const ROW = 17; // from one row of names to the next
const OPAQUE = { agent: 0.9, unsafe: 0.6, goal: 0.3, world: 0.12 };

export class Painter {
  constructor(pen, panels) {
    Object.assign(this, { pen, panels, names: [], rows: 0 });
  }

  // A shape with its arguments by name; what has no finite value is left out.
  draw(shape, given) {
    if (shape.panel === "text" || !Object.values(given).flat().every(Number.isFinite)) return;
    const { pen } = this;
    const panel = this.panels[shape.panel];
    pen.save();
    if (shape.panel === "plane") {
      pen.beginPath();
      pen.rect(panel.left, panel.top, panel.width, panel.height);
      pen.clip();
    }
    pen.strokeStyle = pen.fillStyle = colour(shape.role);
    pen.lineWidth = 3;
    this[`_${shape.kind}`](shape, panel, given);
    pen.restore();
  }

  // Names of shapes, none on another one and all inside the picture.
  label(width, height) {
    const { pen } = this;
    pen.font = "13px system-ui, sans-serif";
    pen.textBaseline = "middle";
    const taken = [];
    for (const { text, role, x, y } of this.names) {
      const wide = pen.measureText(text).width + 6;
      const left = Math.min(Math.max(x - wide / 2, 2), width - wide - 2);
      const rows = [0, -1, 1, -2, 2, -3, 3].map((r) => Math.min(Math.max(y + r * ROW, 9), height - 9));
      const free = (row) =>
        taken.every(
          (t) => Math.abs(t.row - row) >= ROW - 1 || left + wide < t.left || t.left + t.wide < left,
        );
      const row = rows.find(free) ?? rows[0];
      taken.push({ left, wide, row });
      pen.globalAlpha = 0.75;
      pen.fillStyle = colour("back");
      pen.fillRect(left, row - ROW / 2, wide, ROW);
      pen.globalAlpha = 1;
      pen.fillStyle = colour(role);
      pen.fillText(text, left + 3, row);
    }
  }

  #name(shape, x, y) {
    if (shape.name) this.names.push({ text: shape.name, role: shape.role, x, y });
  }

  #area(role, opaque = OPAQUE[role]) {
    this.pen.lineWidth = 1.5;
    this.pen.globalAlpha = opaque;
    this.pen.fill();
    this.pen.globalAlpha = 1;
    this.pen.stroke();
  }

  #lines(...points) {
    this.pen.beginPath();
    points.forEach(([x, y]) => this.pen.lineTo(x, y));
  }

  #arrow(from, to) {
    const angle = Math.atan2(to[1] - from[1], to[0] - from[0]);
    const wing = (turned) => [to[0] - 8 * Math.cos(angle + turned), to[1] - 8 * Math.sin(angle + turned)];
    this.pen.strokeStyle = this.pen.fillStyle = colour("ink");
    this.pen.lineWidth = 2;
    this.#lines(from, to);
    this.pen.stroke();
    this.#lines(to, wing(-0.5), wing(0.5));
    this.pen.fill();
  }

  // In a plane.

  #round(shape, panel, given, radius) {
    const [x, y] = [panel.x.at(given.x[0]), panel.y.at(given.y[0])];
    this.pen.beginPath();
    this.pen.arc(x, y, radius, 0, 7);
    this.#area(shape.role);
    const direction = directionOf(given);
    if (direction) this.#arrow([x, y], [x + (radius + 10) * direction[0], y + (radius + 10) * direction[1]]);
    this.#name(shape, x, y - radius - 12);
  }

  _disk(shape, panel, given) {
    this.#round(shape, panel, given, panel.x.long(given.radius[0]));
  }

  _point(shape, panel, given) {
    this.#round(shape, panel, given, MARK);
  }

  _box(shape, panel, given) {
    const [x, y] = [panel.x.at(given.x[0]), panel.y.at(given.y[0])];
    const [a, b] = [panel.x.long(given.width[0]) / 2, panel.x.long(given.height[0]) / 2];
    const [dx, dy] = directionOf(given) ?? [1, 0];
    const corner = (u, v) => [x + u * dx - v * dy, y + u * dy + v * dx];
    this.#lines(corner(-a, -b), corner(a, -b), corner(a, b), corner(-a, b), corner(-a, -b));
    this.#area(shape.role);
    if (directionOf(given)) this.#arrow(corner(0, 0), corner(a + 8, 0));
    this.#name(shape, x, y - b - 12);
  }

  _segment(shape, panel, given) {
    const [from, to] = [
      ["x", "y"],
      ["x2", "y2"],
    ].map(([u, v]) => [panel.x.at(given[u][0]), panel.y.at(given[v][0])]);
    this.#lines(from, to);
    this.pen.stroke();
    this.#name(shape, (from[0] + to[0]) / 2, (from[1] + to[1]) / 2 - 12);
  }

  _polygon(shape, panel, given) {
    const places = given.points;
    const corners = places.flatMap((x, k) =>
      k % 2 === 0 ? [[panel.x.at(x), panel.y.at(places[k + 1])]] : [],
    );
    this.#lines(...corners, corners[0]);
    this.#area(shape.role);
    this.#name(shape, ...corners[0]);
  }

  _ray(shape, panel, given) {
    const from = [panel.x.at(given.x[0]), panel.y.at(given.y[0])];
    const direction = directionOf(given);
    if (!direction) return;
    const length = given.length ? panel.x.long(given.length[0]) : panel.width + panel.height;
    const to = [from[0] + length * direction[0], from[1] + length * direction[1]];
    this.#lines(from, to);
    this.pen.stroke();
    this.#name(shape, from[0], from[1] - 12);
  }

  // On a line.

  _on_line(shape, panel, given) {
    const { pen } = this;
    const [x, length] = [given.x[0], given.length?.[0] ?? 0];
    const [left, right] = [panel.line.at(x), panel.line.at(x + length)].sort((a, b) => a - b);
    const ground = groundOf(panel);
    let top = ground - CAR - WALL / 4;
    pen.beginPath();
    if (given.length && shape.role === "goal") {
      top = ground - WALL;
      pen.rect(left, top, Math.max(right - left, 4), WALL);
      this.#area(shape.role);
    } else if (given.length) {
      const wide = Math.max(right - left, 8);
      const high = Math.min(Math.max(wide / 2, 14), CAR);
      top = ground - WALL / 2 - high / 2;
      pen.roundRect(left, top, wide, high, 4);
      this.#area(shape.role);
    } else if (shape.role === "agent") {
      top = ground - WALL / 2 - MARK;
      pen.arc(left, ground - WALL / 2, MARK + 3, 0, 7);
      this.#area(shape.role);
    } else {
      top = ground - WALL;
      this.#lines([left, ground], [left, top]);
      pen.stroke();
    }
    if (!shape.name) return;
    const row = panel.top + 9 + this.rows++ * ROW;
    pen.strokeStyle = colour("line");
    pen.lineWidth = 1;
    this.#lines([(left + right) / 2, row + 8], [(left + right) / 2, top - 1]);
    pen.stroke();
    this.#name(shape, (left + right) / 2, row);
  }

  // Levels and angles.

  _level(shape, panel, given) {
    const { pen } = this;
    const [at, left, right] = [panel.level.at(given.value[0]), panel.left, panel.left + panel.width];
    if (given.low) {
      const low = panel.level.at(given.low[0]);
      pen.globalAlpha = Math.min(OPAQUE[shape.role], 0.45);
      pen.fillRect(left, Math.min(at, low), panel.width, Math.abs(low - at));
      pen.globalAlpha = 1;
      this.#lines([left, at], [right, at]);
      pen.stroke();
      if (given.high) {
        const rim = panel.level.at(given.high[0]);
        pen.strokeStyle = colour("ink");
        this.#lines([left, rim], [left, low], [right, low], [right, rim]);
        pen.stroke();
      }
    } else {
      this.#lines([left - 8, at], [right + 8, at]);
      pen.stroke();
    }
    if (!shape.name) return;
    pen.font = "13px system-ui, sans-serif";
    this.#name(shape, right + 18 + pen.measureText(shape.name).width / 2, at);
  }

  _pointer(shape, panel, given) {
    const { pen } = this;
    const [x, y] = [panel.left + panel.width / 2, panel.top + panel.height / 2];
    const [angle, radius] = [given.angle[0], dialOf(panel)];
    const on = (turned, reach) => [x + reach * Math.cos(turned), y - reach * Math.sin(turned)];
    if (given.spread) {
      const half = Math.min(Math.abs(given.spread[0]), Math.PI);
      pen.beginPath();
      pen.moveTo(x, y);
      pen.arc(x, y, radius, -angle - half, -angle + half);
      pen.closePath();
      this.#area(shape.role);
    } else {
      pen.lineWidth = 6;
      this.#lines([x, y], on(angle, radius - 8));
      pen.stroke();
      pen.beginPath();
      pen.arc(x, y, 8, 0, 7);
      pen.fill();
    }
    this.#name(shape, ...on(angle, radius + 16));
  }
}

// Where the road of a panel ends below.
export function groundOf(panel) {
  return panel.top + panel.height - 2;
}

// The radius of a dial.
export function dialOf(panel) {
  return Math.min(panel.width, panel.height) / 2 - 30;
}

// The unit vector of a heading in pixels, null where there is none.
function directionOf(given) {
  if (!given.heading) return null;
  const [dx, dy] = given.heading;
  const size = Math.hypot(dx, dy);
  return size > 0 && Number.isFinite(size) ? [dx / size, -dy / size] : null;
}
