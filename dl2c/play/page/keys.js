// Keys that do what buttons do.

// `does` are calls by key, which say whether they did something; `listening()` whether keys count at all.
export function listen(does, listening) {
  let pointed = false; // whether what has the focus was pointed at, not reached by Tab
  addEventListener("pointerdown", () => (pointed = true));
  addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (key === "Tab") pointed = false;
    const call = does[key.length === 1 ? key.toLowerCase() : key];
    if (!call || event.ctrlKey || event.altKey || event.metaKey || !listening()) return;
    if (means(target, key, pointed)) return;
    if (key === " ") target.blur(); // or else a button that was clicked would be pressed once more
    if (call()) event.preventDefault();
  });
}

// Whether a key is for the element that has the focus; a space is not where that was pointed at.
function means(target, key, pointed) {
  if (target.matches("input[type=number], input[type=text], select")) return true;
  if (target.matches("input[type=range], pre")) return key.startsWith("Arrow");
  return key === " " && !pointed && target.matches("button, input");
}
