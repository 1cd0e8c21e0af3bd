/* The space-time drawing: only what is in the window is in the document. */

const SVG = "http://www.w3.org/2000/svg";
const HEIGHT = 20, HEAD = 30, GUTTER = 100, DIVIDE = 22, BARE = TWO ? 50 : 76, LANES = 6, LANE = 6, LIFELINE = 44, TALLEST = 30_000_000;
const view = document.getElementById("view"), svg = document.getElementById("svg");
const room = document.getElementById("room"), map = document.getElementById("map");

/* What is selected and how it is shown. `passed` are the rows that pass the filters, `shown` the
   first of each step among them, `before` how many of these come before a row. */
const now = { row: -1, time: false, scale: 0.2, shown: [], passed: new Uint8Array(COUNT),
  before: new Int32Array(COUNT + 1) };
/* `spans` is by run where its columns begin, and how wide they are together. */
const layout = { x: [], width: [], spans: [], total: 0 };

function make(name, attributes, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const key in attributes) element.setAttribute(key, attributes[key]);
  element.append(...children);
  return element;
}

/** Where each column begins; a column without a log needs no room for words. */
function arrange() {
  const used = COLUMNS.map((one, n) => !OTHERS.includes(n) || othersUsed().includes(n));
  const bare = COLUMNS.filter((one, n) => used[n] && !one.logged).length;
  const free = Math.max(view.clientWidth, 300) - GUTTER - bare * BARE - DIVIDE * (RUNS.length - 1);
  const wide = Math.max(TWO ? 110 : 170, Math.floor(free / LOGS.length));
  let x = GUTTER;
  layout.width = COLUMNS.map((one, n) => (used[n] ? (one.logged ? wide : BARE) : 0));
  layout.spans = RUNS.map((_, run) => {
    const begin = (x += run ? DIVIDE : 0);
    COLUMNS.forEach((one, n) => {
      if (one.run === run) layout.x[n] = (x += layout.width[n]) - layout.width[n];
    });
    return [begin, x - begin];
  });
  layout.total = x;
}

let foundUsed = null;
/** The columns for all others that a message comes from or goes to. */
function othersUsed() {
  return (foundUsed ??= OTHERS.filter((n) => arrows.some((arrow) => arrow.from === n || arrow.to === n)));
}

const lifeline = (column) => layout.x[column] + (COLUMNS[column].logged ? LIFELINE : BARE / 2);
const timeHeight = () => (COUNT ? (CLOCK[COUNT - 1] - CLOCK[0]) * now.scale + HEIGHT : 0);

const isShown = (row) => now.passed[row] === 1;
/** The rows that stand side by side where a row is shown. */
const abreast = (row) => atStep(row).filter(isShown);
/** Room for the line above the first difference. */
const gap = (row) => (row >= DIFFERENCE ? HEIGHT : 0);
const heightOfAll = () => (now.time ? timeHeight() : now.shown.length * HEIGHT) + gap(COUNT);

/** Down to the middle of a row, from the top of the first. */
function down(row) {
  if (now.time) return (CLOCK[row] - CLOCK[0]) * now.scale + HEIGHT / 2 + gap(row);
  return now.before[row] * HEIGHT + (isShown(row) ? HEIGHT / 2 : 0) + gap(row);
}

/** Down to a time of a log's clock, in whichever order is shown. */
function downTo(ms) {
  const row = search(COUNT, (i) => CLOCK[i] >= ms);
  if (now.time) return (ms - CLOCK[0]) * now.scale + HEIGHT / 2 + gap(row);
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

function resize() {
  arrange();
  room.style.height = `${Math.min(TALLEST, heightOfAll() + HEAD + HEIGHT)}px`;
  room.style.width = `${layout.total}px`;
  drawMap();
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

/** Bars beside the lifeline: each in the first lane that is free. */
const lanes = (function () {
  const ends = LOGS.map(() => []);
  return new Map(bars.map((bar) => {
    const own = ends[ROW.log[bar.first]];
    let lane = own.findIndex((end) => end <= bar.first);
    if (lane < 0) lane = own.length < LANES ? own.length : LANES - 1;
    own[lane] = Math.max(own[lane] ?? 0, bar.last);
    return [bar, lane];
  }));
})();

function draw() {
  const [a, b] = inWindow();
  const first = now.shown[a] ?? 0, last = b > a ? abreast(now.shown[b - 1]).at(-1) : 0;
  const size = { width: view.clientWidth, height: view.clientHeight };
  const at = { left: view.scrollLeft, top: view.scrollTop - HEAD };
  const y = (row) => down(row) - at.top;
  const layers = ["bands", "lines", "bars", "arrows", "marks"].map((name) => make("g", { class: name }));
  const [bands, lines, barLayer, arrowLayer, marks] = layers;
  const moved = make("g", { transform: `translate(${-at.left} 0)` }, ...layers);
  const visible = COLUMNS.map((one, n) => layout.width[n] > 0
    && layout.x[n] + layout.width[n] > at.left && layout.x[n] < at.left + size.width);
  if (b > a) {
    drawBands(bands, a, b, y, at, size);
    for (let n = 0; n < COLUMNS.length; n++) {
      if (visible[n]) lines.append(lifelineOf(n, size.height));
    }
    if (filters.timers.checked) {
      for (const bar of touching(bars, barReach, first, last)) {
        if (visible[ROW.log[bar.first]] && passesBar(bar)) drawBar(barLayer, bar, at, size.height);
      }
    }
    for (const arrow of touching(arrows, arrowReach, first, last)) {
      if (passesArrow(arrow)) drawArrow(arrowLayer, arrow, y);
    }
    drawRows(marks, a, b, y, visible);
    if (TWO) drawDifference(lines, marks, y, at, size);
  }
  svg.setAttribute("width", size.width);
  svg.setAttribute("height", size.height);
  svg.replaceChildren(moved, gutter(a, b, y, size), heads(visible, at, size));
  showWindow();
}

const passesArrow = (arrow) => isShown(arrow.first) || isShown(arrow.last);
const passesBar = (bar) => isShown(bar.first) || (!bar.open && isShown(bar.last));

function drawBands(layer, a, b, y, at, size) {
  const whole = [at.left + 1, size.width - 2];
  for (const row of now.shown.slice(a, b)) {
    const band = (name, [x, width]) => layer.append(
      make("rect", { class: `band ${name}`, x, y: y(row) - HEIGHT / 2, width, height: HEIGHT }));
    if (row === now.row) band("selected", whole);
    for (const one of abreast(row).filter(diverges)) {
      const span = TWO ? layout.spans[runOf(one)] : whole;
      if (row !== now.row) band("wrong", span);
      band("wrong edge", span);
    }
  }
}

/** What divides two runs, and the line above their first difference, with what it is in words. */
function drawDifference(lines, marks, y, at, size) {
  const x = layout.spans[1][0] - DIVIDE / 2;
  lines.append(make("line", { class: "divide", x1: x, x2: x, y1: HEAD, y2: size.height }));
  const middle = DIFFERENCE < Infinity ? y(DIFFERENCE) - HEIGHT : -Infinity;
  if (middle < 0 || middle > size.height + HEIGHT) return;
  marks.append(make("rect", { class: "differs", x: at.left, y: middle - HEIGHT / 2 + 1,
    width: size.width, height: HEIGHT - 2 }));
  const full = `≠ first difference, ${difference()}`, most = Math.floor((size.width - GUTTER) / 6.8);
  marks.append(make("text", { class: "differs", x: at.left + GUTTER, y: middle + 4 },
    full.length > most ? `${full.slice(0, most - 1)}…` : full));
}

function lifelineOf(column, height) {
  const x = lifeline(column);
  return make("line", { class: COLUMNS[column].logged ? "life" : "life bare", x1: x, x2: x, y1: HEAD, y2: height });
}

/** A timer from arming to its end; a tick where the specification has its deadline. */
function drawBar(layer, bar, at, height) {
  const column = ROW.log[bar.first];
  const x = lifeline(column) - 8 - (lanes.get(bar) + 1) * LANE;
  const top = Math.max(down(bar.first) - at.top, HEAD - 10);
  const end = bar.open && !now.time ? down(bar.last) + HEIGHT / 2 : down(bar.last);
  const bottom = Math.min(end - at.top, height + 10);
  const group = make("g", { class: `bar ${["stopped", "expired", "again", "open", "stopped"][bar.how]}` });
  group.append(make("title", {}, said(bar)));
  group.append(make("rect", { x, y: top, width: LANE - 2, height: Math.max(3, bottom - top), rx: 2 }));
  if (bar.how === 1) group.append(make("circle", { class: "fired", cx: x + 2, cy: end - at.top, r: 4 }));
  if (bar.spec !== null && (bar.how === 1 || bar.how === 3 || bar.spec !== bar.ms)) {
    const due = CLOCK[bar.first] + bar.spec, tick = downTo(due) - at.top;
    if (due <= CLOCK[COUNT - 1] && tick > HEAD && tick < height) {
      group.append(make("path", { class: "deadline", d: `M${x - 4} ${tick}h${LANE + 6}` }));
    }
  }
  layer.append(group);
}

/** A timer in words. */
function said(bar) {
  const name = text(bar.first).replace(/^arm /, "").replace(/ \+-?\d+$/, "");
  const spec = bar.spec === null ? "no duration known" : `due after ${bar.spec} ms`;
  const lasted = bar.open ? "" : ` after ${ROW.t[bar.last] - ROW.t[bar.first]} ms`;
  return `${name}: ${spec}, ${ENDS[bar.how]}${lasted}`;
}

/** An arrow; one that arrives nowhere is short. */
function drawArrow(layer, arrow, y) {
  const { kind } = arrow, from = lifeline(arrow.from), to = lifeline(arrow.to);
  const group = make("g", { class: `arrow ${ARROWS[kind].replace(" ", "-")}` });
  const faded = past(arrow.first) || past(arrow.last);
  if (faded) group.classList.add("past");
  group.append(make("title", {}, `${ARROWS[kind]}: ${text(arrow.first)}`));
  const y1 = y(arrow.first), side = Math.sign(to - from) || 1;
  const x1 = from + side * 5;
  if (kind === DELIVERED || kind === DUPLICATE || kind === OVERHEARD) {
    line(group, x1, y1, to - side * 5, y(arrow.last), true);
  } else if (kind === SENDER_UNOBSERVED || kind === FORGED) {
    line(group, from + side * 8, y1, side < 0 ? Math.min(from - 20, to + besides(arrow.first)) : to - 5, y1, true);
    sign(group, from, y1, kind === FORGED ? "!" : "?");
  } else {
    const short = kind === UNOBSERVED ? to - side * 9 : from + (to - from) * 0.55;
    const y2 = y1 + (kind === UNOBSERVED ? 0 : HEIGHT * 0.7);
    if (kind === UNOBSERVED && side > 0) line(group, Math.min(short - 8, from + besides(arrow.first)), y1, short, y2, false);
    else if (kind === IN_FLIGHT) fading(group, x1, y1, short, y2);
    else line(group, x1, y1, short - side * (kind === LOST ? 4 : 0), y2, false);
    if (kind === LOST) cross(group, short, y2);
    if (kind === UNOBSERVED) sign(group, to, y2, "?");
  }
  layer.append(group);
}

/** How far to the right of its lifeline the words of a row end. */
function besides(row) {
  const letters = Math.min(rowText(row).length, roomFor(row));
  return 16 + letters * 6.6;
}

function line(group, x1, y1, x2, y2, pointed) {
  group.append(make("line", { x1, y1, x2, y2 }));
  if (!pointed) return;
  const turn = (Math.atan2(y2 - y1, x2 - x1) * 180) / Math.PI;
  group.append(make("path", { class: "head", d: "M0 0L-9 -4.5L-9 4.5Z",
    transform: `translate(${x2} ${y2}) rotate(${turn})` }));
}

function fading(group, x1, y1, x2, y2) {
  for (let n = 0; n < 5; n++) {
    const part = (k) => [x1 + ((x2 - x1) * k) / 5, y1 + ((y2 - y1) * k) / 5];
    const [[a, b], [c, d]] = [part(n), part(n + 1)];
    group.append(make("line", { x1: a, y1: b, x2: c, y2: d, opacity: 1 - n * 0.2 }));
  }
}

function cross(group, x, y) {
  group.append(make("path", { class: "cross", d: `M${x - 5} ${y - 5}l10 10m0 -10l-10 10` }));
}

function sign(group, x, y, word) {
  group.append(make("text", { class: "sign", x, y: y + 5, "text-anchor": "middle" }, word));
}

const MARKS = {
  send: "M-4 -4L5 0L-4 4Z", receive: "M-4 0a4 4 0 1 0 8 0a4 4 0 1 0 -8 0", timer: "M-2.5 -2.5h5v5h-5Z",
  command: "M0 -5L5 0L0 5L-5 0Z", indication: "M-5 -4h10l-5 9Z", restart: "M-5 -5h10v10h-10Z",
};

/** Of each row a mark on its lifeline, and its words where there is room. */
function drawRows(layer, a, b, y, visible) {
  const free = COLUMNS.map(() => -Infinity);
  for (const row of now.shown.slice(a, b).flatMap(abreast)) {
    const column = ROW.log[row];
    if (!visible[column]) continue;
    const x = lifeline(column), name = kind(row);
    const faded = past(row) ? " past" : "";
    const group = make("g", { class: `row ${name}${faded}`, "data-row": row });
    group.append(make("path", { class: "mark", d: MARKS[name], transform: `translate(${x} ${y(row)})` }));
    if (y(row) - free[column] >= 13 || STEP[row] === STEP[now.row]) {
      free[column] = y(row);
      group.append(words(row, x + 12, y(row) + 4));
    }
    layer.append(group);
  }
}

const roomFor = (row) => Math.floor((layout.width[ROW.log[row]] - LIFELINE - 20) / 6.7);

/** A row in words, with the phase in which it leaves its station. */
function rowText(row) {
  const phase = phaseChange(row);
  const wrong = diverges(row) ? "✗ " : "";
  return wrong + text(row) + (phase ? `  = ${visible(phase)}` : "");
}

function words(row, x, y) {
  const full = rowText(row), most = roomFor(row);
  return make("text", { x, y }, full.length > most ? `${full.slice(0, most - 1)}…` : full);
}

/** The phase in which an event leaves its station, if that is another than before. */
function phaseChange(row) {
  const phase = hint(row)[1];
  return phase && phase !== (phasesBefore[row] || "STANDALONE") ? phase : "";
}

const phasesBefore = (function () {
  const last = LOGS.map(() => ""), found = new Array(COUNT);
  for (let row = 0; row < COUNT; row++) {
    found[row] = last[ROW.log[row]];
    last[ROW.log[row]] = hint(row)[1] || last[ROW.log[row]];
  }
  return found;
})();

/** Numbers of the steps and times, left of the columns. */
function gutter(a, b, y, size) {
  const group = make("g", { class: "gutter" });
  group.append(make("rect", { class: "cover", x: 0, y: 0, width: GUTTER - 6, height: size.height }));
  let free = -Infinity;
  for (let n = a; n < b; n++) {
    const row = now.shown[n];
    if (y(row) - free < 13 || y(row) < HEAD) continue;
    free = y(row);
    const same = { y: y(row) + 4, "text-anchor": "end", class: row === now.row ? "selected" : "" };
    group.append(make("text", { x: 42, ...same }, String(STEP[row] + 1)));
    group.append(make("text", { x: GUTTER - 10, ...same }, String(ROW.t[row])));
  }
  return group;
}

function heads(visible, at, size) {
  const group = make("g", { class: "heads" });
  group.append(make("rect", { class: "cover", x: 0, y: 0, width: size.width, height: HEAD - 2 }));
  const inner = make("g", { transform: `translate(${-at.left} 0)` });
  for (let n = 0; n < COLUMNS.length; n++) {
    if (!visible[n]) continue;
    const name = COLUMNS[n].logged ? COLUMNS[n].name : bareName(n);
    inner.append(make("text", { x: lifeline(n), y: 19, "text-anchor": "middle",
      class: COLUMNS[n].logged ? "name" : "name bare" }, name));
  }
  group.append(inner);
  group.append(make("rect", { class: "cover", x: 0, y: 0, width: GUTTER - 6, height: HEAD - 2 }));
  group.append(make("text", { x: 42, y: 19, "text-anchor": "end", class: "unit" }, "step"));
  group.append(make("text", { x: GUTTER - 10, y: 19, "text-anchor": "end", class: "unit" }, "ms"));
  group.append(make("line", { class: "rule", x1: 0, x2: size.width, y1: HEAD - 2, y2: HEAD - 2 }));
  return group;
}

/** A station without a log; of which run it is, its place tells. */
const bareName = (n) => COLUMNS[n].name.replace(/^[AB] · /, "") + (OTHERS.includes(n) ? "" : "?");

/* The minimap: all rows that are shown, and the window among them. */

const small = document.createElement("canvas");

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function drawMap() {
  map.height = small.height = Math.max(40, map.parentElement.clientHeight);
  small.width = map.width;
  const pen = small.getContext("2d"), drawn = new Set();
  const colours = { send: colour("--send"), receive: colour("--receive"), other: colour("--dim") };
  const wide = (map.width - 8) / LOGS.length;
  for (const row of TWO ? now.shown.flatMap(abreast) : now.shown) {
    const y = Math.floor(mapY(row)), column = ROW.log[row], name = kind(row);
    const key = y * 100_000 + column * 3 + (name === "send" ? 0 : name === "receive" ? 1 : 2);
    if (drawn.has(key)) continue;
    drawn.add(key);
    pen.fillStyle = colours[name] ?? colours.other;
    pen.fillRect(4 + column * wide, y, Math.max(1, wide - 1), 1.5);
  }
  const mark = (row, name) => {
    pen.fillStyle = colour(name);
    pen.fillRect(0, Math.floor(mapY(row)) - 1, map.width, 3);
  };
  if (DIFFERENCE < Infinity) mark(DIFFERENCE, "--told");
  for (const log of LOGS) if (log.diverges >= 0) mark(log.diverges, "--wrong");
}

/** Down to a row in the minimap. */
function mapY(row) {
  const all = heightOfAll();
  return all ? (down(row) / all) * (map.height - 4) : 0;
}

function showWindow() {
  const pen = map.getContext("2d");
  const all = Math.max(1, heightOfAll());
  const scale = (map.height - 4) / all;
  pen.clearRect(0, 0, map.width, map.height);
  pen.drawImage(small, 0, 0);
  pen.strokeStyle = colour("--text");
  pen.lineWidth = 1.5;
  const tall = Math.min(map.height - 3, Math.max(6, view.clientHeight * scale));
  pen.strokeRect(1, Math.min(view.scrollTop * scale + 1, map.height - tall - 2), map.width - 2, tall);
  pen.fillStyle = colour("--accent");
  if (COUNT) pen.fillRect(0, mapY(now.row), map.width, 2);
}
