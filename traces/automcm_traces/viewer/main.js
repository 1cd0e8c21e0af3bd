/* Filters, steps, keys, links, and the table. */

const filters = {};
for (const id of ["text", "station", "session", "type", "cams", "timers"]) {
  filters[id] = document.getElementById(id);
}

const KEYS = [["← →, h l", "step back, step forward"], ["↑ ↓, k j", "the same"],
  ["Page Up, Page Down", "a window back or forward"], ["Home, End", "first, last"],
  ["g", "go to a step"], ["/", "search"], ["n, N", "next or previous row with the text"],
  ["d", "jump to the divergence, or the hazard"], ...(TWO ? [["f", "jump to the first difference"]] : []), ["t", "event order or real time"], ["+ −", "room for a second"],
  ["b", "the rows as a table"], ["?", "this help"]];

/** The type of the message of a row; empty if there is none. */
const typeOf = (row) => ("sr".includes(DATA.rows.kinds[row]) ? body(row).message?.type ?? "" : "");

function passes(row, wanted) {
  if (wanted.station && station(row) !== wanted.station) return false;
  if (wanted.session && session(row) !== wanted.session) return false;
  if (!wanted.cams && ROW.flags[row] & OF_CAM) return false;
  if (!wanted.timers && DATA.rows.kinds[row] === "t") return false;
  if (wanted.type && typeOf(row) !== wanted.type) return false;
  return !wanted.text || text(row).toLowerCase().includes(wanted.text);
}

/** What the filters let pass; a divergence, the first difference and the selected step stay. */
function sift() {
  const wanted = {
    station: Number(filters.station.value), session: filters.session.value, type: filters.type.value,
    cams: filters.cams.checked || filters.type.value === "CAM", timers: filters.timers.checked,
    text: filters.text.value.trim().toLowerCase(),
  };
  now.shown = [];
  for (let row = 0; row < COUNT; row++) {
    const stays = STEP[row] === STEP[now.row] || STEP[row] === STEP[DIFFERENCE] || diverges(row);
    now.passed[row] = stays || passes(row, wanted);
    const joins = isBeside(row) && isShown(row - 1);
    now.before[row] = now.shown.length - joins;
    if (isShown(row) && !joins) now.shown.push(row);
  }
  now.before[COUNT] = now.shown.length;
  document.getElementById("count").textContent = `${now.shown.length} of ${STEPS_IN_ALL} rows`;
  resize();
  fillTable();
}

/** Select the step of a row and bring it into the window. */
function select(row, quietly = false) {
  if (!COUNT) return;
  const found = Math.max(0, Math.min(COUNT - 1, row));
  now.row = isBeside(found) ? found - 1 : found;
  if (!isShown(now.row)) sift();
  if (!quietly) reveal(now.row);
  history.replaceState(null, "", `#step=${STEP[now.row] + 1}`);
  document.getElementById("where").textContent = `${STEP[now.row] + 1} / ${STEPS_IN_ALL}`;
  showPanel(now.row);
  redraw();
}

function reveal(row) {
  const y = down(row), top = view.scrollTop, tall = view.clientHeight - HEAD;
  if (y < top + HEIGHT || y > top + tall - HEIGHT) view.scrollTop = y - tall / 2;
  const x = layout.x[ROW.log[row]] ?? 0, wide = layout.width[ROW.log[row]] ?? 0;
  if (x - GUTTER < view.scrollLeft) view.scrollLeft = x - GUTTER;
  else if (x + wide > view.scrollLeft + view.clientWidth) view.scrollLeft = x - GUTTER;
}

/** So many shown rows on from the selected one. */
function step(by) {
  const count = now.shown.length;
  if (!count) return;
  select(now.shown[Math.max(0, Math.min(count - 1, now.before[now.row] + by))]);
}

function find(by) {
  const words = filters.text.value.trim().toLowerCase();
  for (let row = by > 0 ? atStep(now.row).at(-1) + 1 : now.row - 1; words && row >= 0 && row < COUNT; row += by) {
    if (isShown(row) && text(row).toLowerCase().includes(words)) return select(row);
  }
}

function jump() {
  if (firstWrong !== Infinity) select(firstWrong);
}

function jumpToDifference() {
  if (DIFFERENCE !== Infinity) select(DIFFERENCE);
}

function goTo() {
  const typed = window.prompt(`Step, 1 to ${STEPS_IN_ALL}`, String(STEP[now.row] + 1));
  if (typed && Number.isInteger(Number(typed))) select(rowOfStep(Number(typed) - 1));
}

function toggleTime() {
  now.time = !now.time;
  document.getElementById("order").setAttribute("aria-pressed", now.time);
  document.getElementById("zoom").hidden = !now.time;
  zoom(1);
}

function zoom(by) {
  const long = Math.max(1, COUNT ? CLOCK[COUNT - 1] - CLOCK[0] : 1);
  now.scale = Math.min(TALLEST / long, Math.max(0.005, now.scale * by));
  resize();
  if (COUNT) view.scrollTop = down(now.row) - view.clientHeight / 2;
}

function help() {
  const box = document.getElementById("keys");
  box.replaceChildren(el("h2", {}, "Keys"), el("dl", {}, KEYS.flatMap(([key, what]) =>
    [el("dt", {}, el("kbd", {}, key)), el("dd", {}, what)])),
  el("button", { onclick: () => box.close() }, "Close"));
  box.showModal();
}

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function nameTheme() {
  document.getElementById("theme").textContent = isDark() ? "Light" : "Dark";
}

function toggleTheme() {
  document.documentElement.dataset.theme = isDark() ? "light" : "dark";
  nameTheme();
  resize();
}

/* The table: a real one, some rows at a time. */

const ROWS = 200;
let tableFirst = 0;

function fillTable() {
  const box = document.getElementById("tables");
  if (box.hidden) return;
  tableFirst = Math.max(0, Math.min(tableFirst, now.shown.length - 1));
  fillRows(now.shown.slice(tableFirst, tableFirst + ROWS).flatMap(abreast));
  const last = Math.min(tableFirst + ROWS, now.shown.length);
  box.querySelector("caption").textContent = `Rows ${tableFirst + 1} to ${last} of ${now.shown.length}`;
}

function fillRows(rows) {
  document.getElementById("table").replaceChildren(...rows.map((row) => el("tr",
    diverges(row) ? { class: "wrong" } : isFirst(row) ? { class: "differs" } : past(row) ? { class: "past" } : {},
    el("td", {}, link(row, String(STEP[row] + 1))), el("td", {}, COLUMNS[ROW.log[row]].name),
    el("td", {}, ROW.line[row]), el("td", {}, ROW.t[row]),
    el("td", {}, (isFirst(row) ? "FIRST DIFFERENCE: " : "") + (diverges(row) ? "DIVERGES: " : "") + text(row)),
    el("td", {}, fate(row)))));
}

const isFirst = (row) => STEP[row] === STEP[DIFFERENCE];

function toggleTable() {
  const box = document.getElementById("tables");
  box.hidden = !box.hidden;
  view.hidden = map.hidden = !box.hidden;
  document.getElementById("as-table").setAttribute("aria-pressed", !box.hidden);
  tableFirst = Math.max(0, now.before[now.row] - ROWS / 2);
  fillTable();
  if (box.hidden) resize();
}

function turnTable(by) {
  tableFirst += by;
  fillTable();
}

const ACTIONS = {
  ArrowLeft: () => step(-1), h: () => step(-1), ArrowUp: () => step(-1), k: () => step(-1),
  ArrowRight: () => step(1), l: () => step(1), ArrowDown: () => step(1), j: () => step(1),
  PageUp: () => step(-Math.floor(view.clientHeight / HEIGHT)), PageDown: () => step(Math.floor(view.clientHeight / HEIGHT)),
  Home: () => step(-COUNT), End: () => step(COUNT), g: goTo, d: jump, f: jumpToDifference, n: () => find(1), N: () => find(-1),
  t: toggleTime, "+": () => zoom(2), "-": () => zoom(0.5), b: toggleTable, "?": help,
  "/": () => filters.text.focus(),
};

document.addEventListener("keydown", (press) => {
  const typing = /^(INPUT|SELECT)$/.test(press.target.tagName) && press.target.type !== "checkbox";
  if (typing && press.key === "Escape") view.focus();
  if (typing && press.key === "Enter") find(1);
  const isOpen = document.getElementById("keys").open;
  if (typing || isOpen || press.ctrlKey || press.metaKey || press.altKey) return;
  const action = ACTIONS[press.key];
  if (!action) return;
  press.preventDefault();
  action();
});

function listen() {
  const on = (id, action) => document.getElementById(id).addEventListener("click", action);
  on("previous", () => step(-1));
  on("next", () => step(1));
  on("divergence", jump);
  if (TWO) on("difference", jumpToDifference);
  on("order", toggleTime);
  on("narrower", () => zoom(0.5));
  on("wider", () => zoom(2));
  on("as-table", toggleTable);
  on("table-back", () => turnTable(-ROWS));
  on("table-on", () => turnTable(ROWS));
  on("theme", toggleTheme);
  on("help", help);
  for (const id in filters) filters[id].addEventListener("input", sift);
  view.addEventListener("scroll", redraw, { passive: true });
  svg.addEventListener("click", (press) => {
    const y = press.offsetY + view.scrollTop - HEAD;
    if (press.offsetY < HEAD) return;
    const n = search(now.shown.length, (i) => down(now.shown[i]) + HEIGHT / 2 > y);
    if (n < now.shown.length) select(now.shown[n], true);
  });
  map.addEventListener("pointerdown", (press) => travel(press.offsetY));
  map.addEventListener("pointermove", (press) => press.buttons && travel(press.offsetY));
  new ResizeObserver(resize).observe(view);
  window.addEventListener("hashchange", fromHash);
  window.addEventListener("beforeprint", () => fillRows(now.shown.slice(0, 2000).flatMap(abreast)));
}

function travel(y) {
  view.scrollTop = (y / map.height) * heightOfAll() - view.clientHeight / 2;
}

function fromHash() {
  const found = /[#&]step=(\d+)/.exec(location.hash);
  if (found) select(rowOfStep(Number(found[1]) - 1));
  return Boolean(found);
}

function choices(select_, all, values) {
  select_.append(el("option", { value: "" }, all));
  for (const value of values.slice(0, 500)) select_.append(el("option", { value }, value));
}

function legend() {
  const shown = [[0, "delivered"], [1, "lost"], [2, "duplicate"], [3, "unobserved"], [4, "in flight"],
    [7, "overheard"]];
  document.getElementById("legend").append(...shown.map(([arrow, words]) => {
    const sample = make("svg", { width: 46, height: 16, "aria-hidden": "true" });
    const group = make("g", { class: `arrow ${ARROWS[arrow].replace(" ", "-")}` });
    if (arrow === IN_FLIGHT) fading(group, 3, 8, 36, 8);
    else line(group, 3, 8, arrow === LOST ? 28 : arrow === UNOBSERVED ? 32 : 42, 8, [DELIVERED, DUPLICATE, OVERHEARD].includes(arrow));
    if (arrow === LOST) cross(group, 32, 8);
    if (arrow === UNOBSERVED) sign(group, 39, 8, "?");
    sample.append(group);
    return el("li", {}, sample, words);
  }), timerSample());
}

function timerSample() {
  const sample = make("svg", { width: 46, height: 16, "aria-hidden": "true" });
  sample.append(make("g", { class: "bar expired" }, make("rect", { x: 4, y: 6, width: 32, height: 4, rx: 2 }),
    make("circle", { class: "fired", cx: 36, cy: 8, r: 4 }), make("path", { class: "deadline", d: "M30 1v14" })));
  return el("li", {}, sample, "timer: ● fired, ┃ when the specification says");
}

function types() {
  const found = new Set(DATA.rows.bodies.length < 200_000 ? DATA.shapes.length && typeNames() : []);
  return [...found].sort();
}

/** Every type of message there is, without unpacking what is not a message. */
function typeNames() {
  const holder = DATA.shapes.map((keys) => keys.indexOf("message") + 1);
  const names = DATA.shapes.map((keys) => keys.indexOf("type") + 1);
  const found = new Set();
  for (const packed of DATA.rows.bodies) {
    const m = holder[packed[0]] ? packed[holder[packed[0]]] : null;
    if (Array.isArray(m) && names[m[0]]) found.add(m[names[m[0]]]);
  }
  return found;
}

function begin() {
  const sessions = [...new Set(ROW.session)].map((n) => DATA.strings[n]).filter(Boolean);
  choices(filters.station, "all", [...new Set(LOGS.map((log) => String(log.station)))]);
  choices(filters.session, "all", sessions);
  choices(filters.type, "all", types());
  const button = document.getElementById("divergence");
  button.disabled = firstWrong === Infinity;
  if (firstWrong !== firstDivergence) button.textContent = "Hazard";
  if (TWO) document.getElementById("difference").disabled = DIFFERENCE === Infinity;
  filters.cams.checked = COUNT > 0 && ROW.flags.every((flag) => flag & OF_CAM);
  nameTheme();
  buildPanel();
  legend();
  listen();
  sift();
  const wrong = Math.min(firstDivergence, DIFFERENCE < Infinity ? DIFFERENCE : firstWrong);
  if (!fromHash()) select(wrong === Infinity ? now.shown[0] ?? 0 : wrong);
}

begin();
