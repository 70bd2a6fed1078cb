// The model's text, with what was executed and what is violated.

import { element } from "./elements.js";

export class Listing {
  constructor(place, text) {
    this.place = place;
    this.letters = [...text]; // spans count characters, not UTF-16 units
    this.key = null;
  }

  // Spans are [begin, end] in characters of the text; those that are `broken` win.
  mark(ran, broken) {
    const key = JSON.stringify([ran, broken]);
    if (key === this.key) return;
    this.key = key;
    const ends = [...ran, ...broken].flat();
    const cuts = [...new Set([0, this.letters.length, ...ends])].sort((a, b) => a - b);
    const inside = (spans, from, to) => spans.some(([a, b]) => a <= from && to <= b);
    const parts = cuts.slice(1).map((to, k) => {
      const from = cuts[k];
      const piece = this.letters.slice(from, to).join("");
      if (inside(broken, from, to)) return element("mark", { class: "broken", text: piece });
      return inside(ran, from, to) ? element("mark", { class: "ran", text: piece }) : piece;
    });
    this.place.replaceChildren(...parts);
    this.#reveal();
  }

  // Scrolls the text, not the page, to what ran where none of it is to be seen.
  #reveal() {
    const marks = [...this.place.querySelectorAll("mark.ran")];
    const top = (mark) => mark.offsetTop - this.place.offsetTop;
    const seen = (mark) =>
      top(mark) >= this.place.scrollTop && top(mark) < this.place.scrollTop + this.place.clientHeight;
    if (marks.length > 0 && !marks.some(seen))
      this.place.scrollTop = top(marks[0]) - this.place.clientHeight / 3;
  }
}
