// Elements of the page. Texts are text: nothing in a model becomes markup.

// An element with attributes or properties (`text`, `class`, `on...`) and children.
export function element(name, given = {}, ...children) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(given)) {
    if (key === "text") made.textContent = value;
    else if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
    else if (value === true) made.setAttribute(key, "");
    else if (value !== false && value !== null) made.setAttribute(key, value);
  }
  made.append(...children);
  return made;
}

export function byId(id) {
  return document.getElementById(id);
}

// Sets a text only where it changes, so that readers of screens hear it once.
export function say(target, text) {
  if (target.textContent !== text) target.textContent = text;
}

const NOTHING = 1e-100; // what is smaller is shown as 0

// A number for people: five digits.
export function shown(value) {
  if (!Number.isFinite(value)) return Number.isNaN(value) ? "–" : value > 0 ? "∞" : "−∞";
  const size = Math.abs(value);
  if (size < NOTHING) return "0";
  const text = size < 1e-4 || size >= 1e7 ? value.toExponential(3) : String(Number(value.toPrecision(5)));
  return text.replaceAll("-", "−");
}

// A colour of the page's style.
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}
