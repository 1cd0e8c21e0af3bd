/* What each key does, and the help that says so. */

const KEYS = [
  ["Steps", [["← →, h l, ↑ ↓, k j", "step back, step forward"], ["Page Up, Page Down", "a window back or forward"],
    ["Home, End", "first, last"], ["Space", "play, or pause"], ["g", "go to a step"], ["/", "search; Esc leaves the field"],
    ["n, N", "next or previous row with the text"], ["d", "the divergence, or the hazard"],
    ...(TWO ? [["f", "the first difference"]] : [])]],
  ["Time", [["m", "mark the row: time is measured from it"], ["Shift ↑ ↓, Shift-click", "measure from the row to another"],
    ["z", "show the measured span alone; also drag over the drawing"], ["0, Esc", "show all again, and clear the mark"],
    ["t", "event order or real time"], ["+ −", "room for a second"], ["a", "times from the start, or as logged"]]],
  ["Columns", [["< >", "move the column of the row; also drag its head"],
    [", .", "make it narrower, wider; also drag its edge"], ["[ ]", "make the words narrower, wider"],
    ["r", "the columns as they were"]]],
  ["View", [["x", "unfold the copies of a message (▸ ×3), or fold them"], ["X", "all copies"], ["c", "CAMs"],
    ["T", "timers"], ["o", "follow the message: the rest is dim; also click an arrow"], ["b", "the rows as a table"], ["D", "light or dark"], ["Tab", "to the buttons and filters"],
    ["?", "this help"]]],
];

function help() {
  const box = document.getElementById("keys");
  box.replaceChildren(el("h2", {}, "Keys ", el("button", { onclick: () => box.close() }, "Close")), el("div", { class: "groups" }, KEYS.map(([name, keys]) =>
    el("section", {}, el("h3", {}, name), el("dl", {}, keys.flatMap(([key, what]) =>
      [el("dt", {}, el("kbd", {}, key)), el("dd", {}, what)]))))),
  el("h3", {}, "Marks and phases"), el("ul", { class: "samples" }, samples()));
  box.showModal();
}

/** Turn a filter with a box on or off. */
function toggleFilter(name) {
  filters[name].checked = !filters[name].checked;
  sift();
}

const ACTIONS = {
  ArrowLeft: () => step(-1), h: () => step(-1), ArrowUp: () => step(-1), k: () => step(-1),
  ArrowRight: () => step(1), l: () => step(1), ArrowDown: () => step(1), j: () => step(1),
  PageUp: () => step(-Math.floor(view.clientHeight / HEIGHT)), PageDown: () => step(Math.floor(view.clientHeight / HEIGHT)),
  Home: () => step(-COUNT), End: () => step(COUNT), g: goTo, d: jump, f: jumpToDifference, n: () => find(1), N: () => find(-1),
  " ": togglePlay, "/": focusSearch, "?": help,
  m: toggleMark, z: zoomToSpan, 0: showWhole, Escape: showWhole, t: toggleTime, a: toggleLogged,
  "+": () => zoom(2), "-": () => zoom(0.5),
  "<": () => moveColumn(ownColumn(), -1), ">": () => moveColumn(ownColumn(), 1),
  ",": () => widen(ownColumn(), layout.width[ownColumn()] - 16), ".": () => widen(ownColumn(), layout.width[ownColumn()] + 16),
  "[": () => widenWords(layout.words - 24), "]": () => widenWords(layout.words + 24), r: resetColumns,
  x: () => toggleCopies(now.row), X: () => toggleFilter("copies"), c: () => toggleFilter("cams"),
  T: () => toggleFilter("timers"), b: toggleTable, o: () => setFollow(!now.follow), D: toggleTheme,
};
const EXTENDING = { ArrowLeft: -1, ArrowUp: -1, ArrowRight: 1, ArrowDown: 1 };

function focusSearch() {
  if (!document.body.classList.contains("more")) toggleControls();
  filters.text.focus();
}

document.addEventListener("keydown", (press) => {
  const typing = /^(INPUT|SELECT)$/.test(press.target.tagName) && press.target.type !== "checkbox";
  if (typing && press.key === "Escape") view.focus();
  if (typing && press.key === "Enter") find(1);
  const isOpen = document.getElementById("keys").open;
  if (typing || isOpen || press.ctrlKey || press.metaKey || press.altKey) return;
  const by = press.shiftKey && EXTENDING[press.key];
  const action = by ? () => extend(by) : ACTIONS[press.key];
  if (!action || !COUNT) return;
  press.preventDefault();
  action();
});
