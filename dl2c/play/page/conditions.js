// What the numbers of comparisons say of the conditions that are made of them.
//
// A tree is ["and", ...trees], ["or", ...trees], a truth, or the number of a comparison.

// By how much a comparison holds: negative where it does not.
export function clearance(atom, margin) {
  if (atom.op === "=") return -Math.abs(margin);
  return atom.op === "!=" ? Math.abs(margin) : margin;
}

export function holds(tree, truth) {
  if (typeof tree === "boolean") return tree;
  if (typeof tree === "number") return truth[tree];
  const [word, ...parts] = tree;
  return word === "and" ? parts.every((t) => holds(t, truth)) : parts.some((t) => holds(t, truth));
}

// By how much a condition holds: of a conjunction the least of its parts, of a disjunction the greatest.
export function clearanceOf(tree, atoms, margin) {
  if (typeof tree === "boolean") return tree ? Infinity : -Infinity;
  if (typeof tree === "number") return clearance(atoms[tree], margin[tree]);
  const [word, ...parts] = tree;
  const found = parts.map((t) => clearanceOf(t, atoms, margin));
  return word === "and" ? Math.min(...found) : Math.max(...found);
}

// The comparisons to blame for a condition that does not hold.
export function failing(tree, truth) {
  if (typeof tree === "boolean" || holds(tree, truth)) return [];
  if (typeof tree === "number") return [tree];
  return [...new Set(tree.slice(1).flatMap((t) => failing(t, truth)))];
}

// The parts of a conjunction; of anything else, itself.
export function conjuncts(tree) {
  return Array.isArray(tree) && tree[0] === "and" ? tree.slice(1).flatMap(conjuncts) : [tree];
}

// The comparisons in a tree, in order.
export function atomsIn(tree) {
  if (typeof tree === "boolean") return [];
  return typeof tree === "number" ? [tree] : [...new Set(tree.slice(1).flatMap(atomsIn))];
}

// A condition as text: as the model writes its comparisons, or in `full`, with all definitions expanded.
export function written(tree, atoms, full = false) {
  if (typeof tree === "boolean") return String(tree);
  if (typeof tree === "number") return full ? atoms[tree].full : atoms[tree].text.replace(/^\((.*)\)$/, "$1");
  const [word, ...parts] = tree;
  const inner = parts.map((t) =>
    Array.isArray(t) ? `(${written(t, atoms, full)})` : written(t, atoms, full),
  );
  return inner.join(word === "and" ? " & " : " | ");
}
