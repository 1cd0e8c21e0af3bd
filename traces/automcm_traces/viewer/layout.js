/* Where everything stands: the gutter, then for each run the words of its events and its columns. */

const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 20, HEAD = 40, STEP_WIDE = 50, DIVIDE = 22, LANES = 6, LANE = 6, TALLEST = 30_000_000;
const FONT = '12px system-ui, "Segoe UI", "DejaVu Sans", sans-serif';
const view = document.getElementById("view"), svg = document.getElementById("svg");
const room = document.getElementById("room");

/* What is selected and how it is shown. `mark` is the row from which time is measured, `span` the
   first and last row when the drawing shows no others. `passed` are the rows that pass the filters,
   `shown` the first of each step among them, `before` how many of these come before a row. `order`
   has the columns of each run, `widths` those that were resized, `words` the width of the words. With `follow`, all but the selected message is dim. */
const now = { row: -1, mark: -1, span: null, time: false, logged: false, scale: 0.2, shown: [],
  passed: new Uint8Array(COUNT), before: new Int32Array(COUNT + 1), unfolded: new Set(),
  order: columnsOfRuns(), widths: new Map(), words: 0, follow: false };
/* `step` and `gutter` are the widths of the steps and of these with the times. By run, `text` is
   where the words begin, and `spans` where the run begins and how wide it is. */
const layout = { step: STEP_WIDE, gutter: 100, words: 0, text: [], x: [], width: [], spans: [], total: 0 };

function columnsOfRuns() {
  return RUNS.map((_, run) => [...COLUMNS.keys()].filter((n) => COLUMNS[n].run === run));
}

const pen = document.createElement("canvas").getContext("2d");
const measured = new Map();

/** The width of a text in the drawing. */
function textWidth(words) {
  if (!measured.has(words)) {
    if (measured.size > 5000) measured.clear();
    pen.font = FONT;
    measured.set(words, pen.measureText(words).width);
  }
  return measured.get(words);
}

/* What words can do without, first the session, then what the bands and arrows show too. */
const SPARED = [/ \d+\/\d+(#\d+)?/g, / = [A-Z]+$/, / ->(\d+|all)/, /#\d+/g, / \+-?\d+$/];

/** A text as it fits into a width: whole, else without what it can do without, else cut. */
function fitted(words, width) {
  let brief = words;
  for (const spared of SPARED) {
    if (textWidth(brief) <= width) return brief;
    brief = brief.replace(spared, "");
  }
  if (textWidth(brief) <= width) return brief;
  let end = Math.min(brief.length, Math.ceil(width / 4));
  while (end > 1 && textWidth(`${brief.slice(0, end)}…`) > width) end--;
  return `${brief.slice(0, end).trimEnd()}…`;
}

/** About the width of the longest words. */
const longestWords = (function () {
  const letters = DATA.rows.texts.reduce((most, one) => Math.max(most, one.length), 0);
  return Math.min(340, (letters + (LOGS.length > 1 ? 6 : 0)) * 7 + 40);
})();

function arrange() {
  const space = Math.max(view.clientWidth, 300), small = space < 500;
  layout.step = small ? 0 : STEP_WIDE;
  layout.gutter = layout.step + Math.max(50, 20 + widest() * 7);
  const used = COLUMNS.map((_, n) => !OTHERS.includes(n) || othersUsed().includes(n));
  const count = used.filter(Boolean).length, least = small ? 42 : TWO ? 46 : 56;
  const ruler = now.time ? RULER : 0, free = space - layout.gutter - DIVIDE * (RUNS.length - 1) - ruler;
  layout.words = now.words
    || Math.max(small ? 130 : 170, Math.min(longestWords, Math.floor((free - count * least) / RUNS.length)));
  const wide = Math.max(least, Math.min(260, Math.floor((free - layout.words * RUNS.length) / count)));
  layout.width = COLUMNS.map((_, n) => (used[n] ? now.widths.get(n) ?? wide : 0));
  let x = layout.gutter;
  layout.spans = now.order.map((columns, run) => {
    const begin = (x += run ? DIVIDE : 0);
    layout.text[run] = x;
    x += layout.words;
    for (const n of columns) layout.x[n] = (x += layout.width[n]) - layout.width[n];
    return [begin, x - begin];
  });
  layout.total = x + ruler;
}

/** The time of a row: from the start of the run, or as its log has it. */
const timeText = (row) => String(now.logged ? ROW.t[row] : sinceStart(row));

/** The most digits that a time has. */
function widest() {
  if (!COUNT) return 1;
  return now.logged ? Math.max(...rowsOf.map((rows) => String(ROW.t[rows.at(-1) ?? 0]).length))
    : String(CLOCK[COUNT - 1] - CLOCK[0]).length;
}

let foundUsed = null;
/** The columns for all others that a message comes from or goes to. */
function othersUsed() {
  return (foundUsed ??= OTHERS.filter((n) => arrows.some((arrow) => arrow.from === n || arrow.to === n)));
}

const lifeline = (column) => layout.x[column] + layout.width[column] / 2;
/** What does not scroll sideways: the gutter, and the words of a single run. */
const fixedWidth = () => layout.gutter + (TWO ? 0 : layout.words);
const firstRow = () => now.span?.[0] ?? 0;
const lastShownRow = () => now.span?.[1] ?? COUNT - 1;
const timeHeight = () => (COUNT ? timeDown(CLOCK[lastShownRow()]) + HEIGHT : 0);

const isShown = (row) => now.passed[row] === 1;
/** The rows that stand side by side where a row is shown. */
const abreast = (row) => atStep(row).filter(isShown);
/** Room for the line above the first difference; in real time rows may stand right above it. */
const gap = (row) => (row >= DIFFERENCE ? (now.time ? 2 : 1) * HEIGHT : 0);
const heightOfAll = () => (now.time ? timeHeight() : now.shown.length * HEIGHT) + gap(COUNT);

/** Down to the middle of a row, from the top of the first. */
function down(row) {
  if (now.time) return timeDown(CLOCK[row]) + HEIGHT / 2 + gap(row);
  return now.before[row] * HEIGHT + (isShown(row) ? HEIGHT / 2 : 0) + gap(row);
}

/** Down to a time of a log's clock, in whichever order is shown. */
function downTo(ms) {
  const row = search(COUNT, (i) => CLOCK[i] >= ms);
  if (now.time) return timeDown(ms) + HEIGHT / 2 + gap(row);
  return now.before[row] * HEIGHT + gap(row);
}

/** The places in `now.shown` that are in the window. */
function inWindow() {
  const top = view.scrollTop, bottom = top + view.clientHeight - HEAD;
  const count = now.shown.length;
  if (now.time) {
    return [search(count, (i) => down(now.shown[i]) >= top - HEIGHT),
      search(count, (i) => down(now.shown[i]) > bottom + HEIGHT)];
  }
  return [Math.max(0, Math.floor(top / HEIGHT) - 2), Math.min(count, Math.ceil(bottom / HEIGHT) + 1)];
}

/** The shown row that is nearest to a height of the window. */
function rowAt(y) {
  const to = y + view.scrollTop - HEAD, far = (n) => Math.abs(down(now.shown[n]) - to);
  const n = Math.min(search(now.shown.length, (i) => down(now.shown[i]) >= to), now.shown.length - 1);
  if (n === 0 || far(n) <= far(n - 1)) return now.shown[n];
  const before = down(now.shown[n - 1]);
  return now.shown[search(n, (i) => down(now.shown[i]) >= before)];
}

function resize() {
  findCuts();
  arrange();
  room.style.height = `${Math.min(TALLEST, heightOfAll() + HEAD + HEIGHT)}px`;
  room.style.width = `${layout.total}px`;
  drawMap();
  toHash();
  redraw();
}

let asked = false;
/** Draw anew before the next frame. */
function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => {
    asked = false;
    draw();
  });
}
