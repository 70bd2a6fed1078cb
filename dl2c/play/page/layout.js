// Where the parts of a scene stand in its picture, and which numbers its axes show.

const PADDING = 0.04; // of the extent of an axis, so that nothing ends at the edge
const LEFT = 42; // pixels that the numbers of an axis take, to the left of one that goes up
const BELOW = 32; // and below one that goes right
const EDGE = 10;
const ROAD_HEIGHT = 170;
const AXIS_OF = { x: "plane", y: "plane", line: "line", level: "level" };

// Numbers along an axis: `low` is at pixel `start`, the next unit `step` further.
class Scale {
  constructor([low, high], start, step) {
    Object.assign(this, { low, high, start, step });
  }

  at(value) {
    return Math.min(Math.max(this.start + (value - this.low) * this.step, -8000), 8000);
  }

  long(length) {
    return Math.max(1, Math.abs(length * this.step));
  }

  // Pixels of round numbers, and the numbers.
  ticks() {
    const span = this.high - this.low;
    const base = 10 ** Math.floor(Math.log10(span / 4));
    const size = base * [1, 2, 5, 10].find((f) => span / (base * f) <= 8);
    const first = Math.ceil(this.low / size);
    const count = Math.floor(this.high / size) - first + 1;
    return Array.from({ length: Math.max(0, count) }, (_, k) => {
      const value = (first + k) * size;
      return [this.at(value), String(Number(value.toPrecision(10)))];
    });
  }
}

// The arguments of a shape by name, each a list of values.
export function argumentsOf(shape, values) {
  return Object.fromEntries(
    Object.entries(shape.arguments).map(([name, places]) => [name, places.map((k) => values[k])]),
  );
}

// The height of a picture of a width.
export function heightOf(scene, width) {
  const flat = scene.shapes.every((s) => s.panel === "line" || s.panel === "text");
  return flat ? ROAD_HEIGHT + EDGE : Math.min(Math.max(0.62 * width, 260), 460);
}

// The limits of all axes by name; `values` are those where an episode begins.
export function limitsOf(scene, values) {
  return Object.fromEntries(
    Object.entries(scene.axes).map(([name, axis]) => {
      const seen = scene.shapes
        .filter((s) => s.panel === AXIS_OF[name])
        .flatMap((shape) => endsOf(name, shape, argumentsOf(shape, values)))
        .filter(Number.isFinite);
      const [least, most] = seen.length > 0 ? [Math.min(...seen), Math.max(...seen)] : [0, 0];
      const around = 0.5 * Math.max(most - least, 1);
      const low = axis.low ?? Math.min(least, axis.high ?? least) - around;
      const high = axis.high ?? Math.max(most, low) + around;
      const padding = PADDING * (high - low) || 1;
      return [name, [low - padding, high + padding]];
    }),
  );
}

// How far a shape reaches along an axis.
function endsOf(axis, shape, given) {
  if (shape.kind === "polygon") return given.points.filter((_, k) => k % 2 === (axis === "y" ? 1 : 0));
  if (axis === "line") return [given.x[0], given.x[0] + (given.length?.[0] ?? 0)];
  if (axis === "level") return ["value", "low", "high"].flatMap((name) => given[name] ?? []);
  const sizes = ["radius", "length", "width", "height"].flatMap((name) => given[name] ?? []).map(Math.abs);
  const reach = Math.max(0, ...sizes);
  return [axis, `${axis}2`].flatMap((name) => given[name] ?? []).flatMap((v) => [v - reach, v + reach]);
}

// The panels of a picture by name, each a rectangle in pixels with the scales that it has.
export function panelsOf(scene, limits, width, height) {
  const kinds = [...new Set(scene.shapes.map((s) => s.panel))];
  const above = ["plane", "level", "dial"].filter((kind) => kinds.includes(kind));
  const found = {};
  let bottom = height - EDGE;
  if (kinds.includes("line")) {
    found.line = linePanel(
      limits.line,
      EDGE,
      bottom - ROAD_HEIGHT + EDGE,
      width - 2 * EDGE,
      ROAD_HEIGHT - EDGE,
    );
    bottom -= ROAD_HEIGHT;
  }
  above.forEach((kind, k) => {
    const share = (width - 2 * EDGE) / above.length;
    const frame = [EDGE + k * share, EDGE, share, bottom - EDGE];
    if (kind === "plane") found.plane = planePanel(limits.x, limits.y, ...frame);
    else if (kind === "level") found.level = levelPanel(limits.level, ...frame);
    else found.dial = { left: frame[0], top: frame[1], width: frame[2], height: frame[3] };
  });
  return found;
}

function linePanel(limits, left, top, width, height) {
  const scale = new Scale(limits, left, width / (limits[1] - limits[0]));
  return { left, top, width, height: height - BELOW, line: scale };
}

function planePanel(x, y, left, top, width, height) {
  const [wide, high] = [width - LEFT, height - BELOW];
  const step = Math.min(wide / (x[1] - x[0]), high / (y[1] - y[0]));
  const [across, up] = [(x[1] - x[0]) * step, (y[1] - y[0]) * step];
  const [begin, end] = [left + LEFT + (wide - across) / 2, top + (high - up) / 2];
  return {
    left: begin,
    top: end,
    width: across,
    height: up,
    x: new Scale(x, begin, step),
    y: new Scale(y, end + up, -step),
  };
}

function levelPanel(limits, left, top, width, height) {
  const across = Math.min(170, width / 3);
  const begin = left + LEFT + Math.max(0, (width - across) / 2 - 2 * LEFT);
  return {
    left: begin,
    top,
    width: across,
    height: height - EDGE,
    level: new Scale(limits, top + height - EDGE, (EDGE - height) / (limits[1] - limits[0])),
  };
}
