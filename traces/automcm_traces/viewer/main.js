/* Filters, steps, links; and how the page begins. */

const filters = {};
for (const id of ["text", "station", "session", "type", "fate", "rejected", "cams", "timers", "copies"]) {
  filters[id] = document.getElementById(id);
}

/** The type of the message of a row; empty if there is none. */
const typeOf = (row) => ("sr".includes(DATA.rows.kinds[row]) ? body(row).message?.type ?? "" : "");

function passes(row, wanted) {
  if (isFolded(row)) return false;
  if (wanted.station && station(row) !== wanted.station) return false;
  if (wanted.session && session(row) !== wanted.session) return false;
  if (!wanted.cams && ROW.flags[row] & OF_CAM) return false;
  if (!wanted.timers && DATA.rows.kinds[row] === "t" && !phaseChange(row)) return false;
  if (wanted.type && typeOf(row) !== wanted.type) return false;
  if (wanted.rejected === "none" ? cause(row) : wanted.rejected && cause(row) !== wanted.rejected) return false;
  if (wanted.fate && !(fatesOf(row) & wanted.fate)) return false;
  return !wanted.text || rowText(row).toLowerCase().includes(wanted.text);
}

/** What the filters let pass; a divergence, a hazard's ends, the first difference and the selected
    step stay. */
function sift() {
  const wanted = {
    station: Number(filters.station.value), session: filters.session.value, type: filters.type.value,
    cams: filters.cams.checked || filters.type.value === "CAM", timers: filters.timers.checked,
    text: filters.text.value.trim().toLowerCase(), rejected: filters.rejected.value,
    fate: filters.fate.value && 1 << ARROWS.indexOf(filters.fate.value),
  };
  now.shown = [];
  for (let row = 0; row < COUNT; row++) {
    const inside = !now.span || (row >= now.span[0] && row <= now.span[1]);
    const stays = STEP[row] === STEP[now.row] || STEP[row] === STEP[DIFFERENCE] || diverges(row)
      || HAZARDS.some(({ ends }) => ends.includes(row)) || VIOLATIONS.some((one) => one.row === row);
    now.passed[row] = inside && (stays || passes(row, wanted));
    const joins = isBeside(row) && isShown(row - 1);
    now.before[row] = now.shown.length - joins;
    if (isShown(row) && !joins) now.shown.push(row);
  }
  now.before[COUNT] = now.shown.length;
  document.getElementById("count").textContent = `${now.shown.length} of ${STEPS_IN_ALL}`;
  resize();
  fillTable();
}

/** Filter anew; of the step that was selected, if it does not pass, the next that does is selected. */
function chooseRows() {
  const row = now.row;
  now.row = -1;
  sift();
  const next = now.shown.find((one) => one >= row) ?? now.shown.at(-1);
  if (next === undefined) now.row = row;
  else select(isShown(row) ? row : next);
}

/** Select the step of a row and bring it into the window. */
function select(row, quietly = false) {
  if (!COUNT) return;
  const found = Math.max(0, Math.min(COUNT - 1, row));
  now.row = isBeside(found) ? found - 1 : found;
  if (now.span && (now.row < now.span[0] || now.row > now.span[1])) leaveSpan();
  if (!isShown(now.row)) sift();
  if (!quietly) reveal(now.row);
  toHash();
  document.getElementById("where").textContent = `${STEP[now.row] + 1} / ${STEPS_IN_ALL}`;
  showPanel(now.row);
  showSpan();
  redraw();
}

function reveal(row) {
  const y = down(row), top = view.scrollTop, tall = view.clientHeight - HEAD;
  if (y < top + HEIGHT || y > top + tall - HEIGHT) view.scrollTop = y - tall / 2;
  const x = layout.x[ROW.log[row]] ?? 0, wide = layout.width[ROW.log[row]] ?? 0;
  const hidden = x - fixedWidth() < view.scrollLeft || x + wide > view.scrollLeft + view.clientWidth;
  if (hidden) view.scrollLeft = x - fixedWidth();
}

/** So many shown rows on from the selected one. */
function step(by) {
  const count = now.shown.length;
  if (!count) return;
  select(now.shown[Math.max(0, Math.min(count - 1, now.before[now.row] + by))]);
}

let playing = 0;
const STEP_MS = 300;

/** Step on by itself until the last step: each row after a while, with traffic in its own time. */
function togglePlay() {
  clearInterval(playing);
  const from = CLOCK[now.row], began = performance.now();
  playing = playing ? 0 : setInterval(() => {
    const ms = from + performance.now() - began;
    const next = now.before[now.row] + 1;
    if (next >= now.shown.length) return togglePlay();
    if (!DATA.traffic) return step(1);
    const reached = now.shown.findLast((row) => CLOCK[row] <= ms) ?? now.row;
    if (reached > now.row) select(reached);
    return showTraffic(now.row, ms);
  }, DATA.traffic ? 100 : STEP_MS);
  const button = document.getElementById("play");
  button.textContent = playing ? "Pause" : "Play";
  button.setAttribute("aria-pressed", Boolean(playing));
}

function find(by) {
  const words = filters.text.value.trim().toLowerCase();
  for (let row = by > 0 ? atStep(now.row).at(-1) + 1 : now.row - 1; words && row >= 0 && row < COUNT; row += by) {
    if (isShown(row) && rowText(row).toLowerCase().includes(words)) return select(row);
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

/** Times from the start of the run, or as each log has them. */
function toggleLogged() {
  now.logged = !now.logged;
  document.getElementById("logged").setAttribute("aria-pressed", now.logged);
  resize();
  fillTable();
}

function zoom(by) {
  const long = Math.max(1, COUNT ? CLOCK[lastShownRow()] - CLOCK[firstRow()] : 1);
  now.scale = Math.min(TALLEST / long, Math.max(0.005, now.scale * by));
  resize();
  if (COUNT) view.scrollTop = down(now.row) - view.clientHeight / 2;
}

/** On a small screen: all controls, or those for the steps alone. */
function toggleControls() {
  const more = document.body.classList.toggle("more");
  document.getElementById("more").setAttribute("aria-expanded", more);
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

function listen() {
  const on = (id, action) => document.getElementById(id).addEventListener("click", action);
  on("previous", () => step(-1));
  on("next", () => step(1));
  on("play", togglePlay);
  on("divergence", jump);
  if (TWO) on("difference", jumpToDifference);
  on("order", toggleTime);
  on("logged", toggleLogged);
  on("narrower", () => zoom(0.5));
  on("wider", () => zoom(2));
  on("as-table", toggleTable);
  on("table-back", () => turnTable(-ROWS));
  on("table-on", () => turnTable(ROWS));
  on("theme", toggleTheme);
  on("more", toggleControls);
  on("measure", toggleMark);
  on("follow", () => setFollow(!now.follow));
  on("span-zoom", zoomToSpan);
  on("span-whole", showWhole);
  on("span-clear", () => setMark(-1));
  on("help", help);
  for (const id in filters) filters[id].addEventListener("input", chooseRows);
  view.addEventListener("scroll", redraw, { passive: true });
  svg.onpointermove = point;
  svg.addEventListener("pointerdown", (press) => {
    if (press.button || !now.shown.length) return;
    if (press.offsetY < HEAD) dragHead(press);
    else if (press.pointerType !== "touch") dragSpan(press);
  });
  svg.addEventListener("click", (press) => {
    if (press.pointerType !== "touch" || press.offsetY < HEAD || !now.shown.length) return;
    const row = rowAt(press.offsetY);
    select(row, true);
    if (press.target.closest(".copies")) toggleCopies(row);
  });
  map.addEventListener("pointerdown", (press) => travel(press.offsetY));
  map.addEventListener("pointermove", (press) => press.buttons && travel(press.offsetY));
  new ResizeObserver(refit).observe(view);
  window.addEventListener("hashchange", fromHash);
  window.addEventListener("beforeprint", () => fillRows(now.shown.slice(0, 2000).flatMap(abreast)));
}

let tall = view.clientHeight;
/** Fit the drawing into a window of another size; a selected row that was in it stays in it. */
function refit() {
  const y = COUNT ? down(now.row) - view.scrollTop : 0, wasIn = y >= 0 && y <= tall - HEAD;
  tall = view.clientHeight;
  resize();
  if (COUNT && wasIn) reveal(now.row);
  if (COUNT) showTraffic(now.row);
}

function travel(y) {
  view.scrollTop = (y / map.height) * heightOfAll() - view.clientHeight / 2;
}

function begin() {
  const sessions = [...new Set(ROW.session)].map((n) => DATA.strings[n]).filter(Boolean);
  choices(filters.station, "all", [...new Set(LOGS.map((log) => String(log.station)))]);
  choices(filters.session, "all", sessions);
  choices(filters.type, "all", types());
  choices(filters.fate, "all", ARROWS.filter((_, kind) => arrows.some((arrow) => arrow.kind === kind)));
  choices(filters.rejected, "all rows", ["none", ...CAUSES]);
  filters.rejected.parentElement.hidden = !CAUSES.length;
  const button = document.getElementById("divergence");
  button.disabled = firstWrong === Infinity;
  if (firstWrong !== firstDivergence) button.textContent = "Hazard";
  if (TWO) document.getElementById("difference").disabled = DIFFERENCE === Infinity;
  filters.cams.checked = COUNT > 0 && ROW.flags.every((flag) => flag & OF_CAM);
  rememberUsual();
  nameTheme();
  buildPanel();
  legend();
  listen();
  sift();
  const wrong = Math.min(firstDivergence, DIFFERENCE < Infinity ? DIFFERENCE : firstWrong);
  if (!fromHash()) select(wrong === Infinity ? now.shown[0] ?? 0 : wrong);
}

begin();
