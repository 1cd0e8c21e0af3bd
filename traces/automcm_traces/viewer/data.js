"use strict";
/* What Python wrote (page_data.py), and what is worked out of it once. */

const DATA = JSON.parse(document.getElementById("data").textContent);
const ARROWS = ["delivered", "lost", "duplicate", "unobserved", "in flight",
  "sender unobserved", "forged", "overheard", "rejected"];
const [DELIVERED, LOST, DUPLICATE, UNOBSERVED, IN_FLIGHT, SENDER_UNOBSERVED, FORGED, OVERHEARD, REJECTED] = ARROWS.keys();
const ENDS = ["stopped", "expired", "armed anew", "still running", "ended by a restart"];
const KIND = {
  s: "send", r: "receive", t: "timer", c: "command", i: "indication", x: "restart",
};
const OF_CAM = 1, IS_CAM = 2, BESIDE = 4, UNTOLD = -1000000;

const COUNT = DATA.rows.kinds.length;
const LOGS = DATA.logs;
const RUNS = DATA.runs, TWO = RUNS.length > 1;
const named = (run, name) => (TWO ? `${"AB"[run]} · ${name}` : String(name));
/* Columns: the logs, the stations without one, and in each run one for all others. */
const COLUMNS = LOGS.map(({ run, station, file, header }) => {
  const own = RUNS[run].verdicts.find((verdict) => verdict.file === file)?.sessions ?? [];
  const roles = [...new Set(own.map(({ role }) => role))].sort().join(", ");
  return { run, station, name: named(run, station), logged: true, called: String(header.x_name ?? ""), roles };
});
RUNS.forEach(({ ghosts }, run) => {
  for (const station of ghosts) COLUMNS.push({ run, station, name: named(run, station), logged: false });
});
const OTHERS = RUNS.map(({ crowded }, run) =>
  COLUMNS.push({ run, name: named(run, crowded ? "others" : "?"), logged: false }) - 1);

/** A column of the table of rows; one number stands for a column of nothing else. */
function column(name, Numbers = Int32Array) {
  const found = DATA.rows[name];
  return Array.isArray(found) ? Numbers.from(found) : new Numbers(COUNT).fill(found);
}

/** 0 means the next new value, n the one n back from there. */
function referred(name) {
  const places = column(name);
  let next = 0;
  for (let row = 0; row < COUNT; row++) places[row] = places[row] ? next - places[row] : next++;
  return places;
}

const ROW = {
  log: column("log"), line: column("line"), t: column("t", Float64Array), session: column("session"),
  hint: column("hint"), flags: column("flags"), text: referred("text"), body: referred("body"),
};
/* Two events of two runs that stand beside each other are one step. */
const STEP = new Int32Array(COUNT);
const isBeside = (row) => row < COUNT && (ROW.flags[row] & BESIDE) !== 0;
/** The events of the step that a row begins. */
const atStep = (row) => (isBeside(row + 1) ? [row, row + 1] : [row]);
const rowsOf = LOGS.map(() => []);
/* Time on the clock of the first log; what stands beside another event has its time, and what follows
   it in its log counts from there. CLOCK is the same, but never goes back from row to row. */
const TIME = new Float64Array(COUNT), CLOCK = new Float64Array(COUNT);

(function addUp() {
  const last = LOGS.map(() => 1), ahead = LOGS.map((log) => log.ahead);
  let t = 0, clock = 0, at = 0, step = -1;
  for (let row = 0; row < COUNT; row++) {
    const log = ROW.log[row];
    last[log] += ROW.line[row] + 1;
    ROW.line[row] = last[log];
    t += ROW.t[row];
    ROW.t[row] = t;
    if (isBeside(row)) ahead[log] = t - at;
    else step++;
    STEP[row] = step;
    at = t - ahead[log];
    clock = row ? Math.max(clock, at) : at;
    TIME[row] = at;
    CLOCK[row] = clock;
    rowsOf[log].push(row);
  }
})();

/** The time of a row in ms from the start of the run, on the clock of the first log. */
const sinceStart = (row) => TIME[row] - CLOCK[0];

/** An object or list as it was before it was packed (page_pack.py). */
function unpack(packed) {
  if (!Array.isArray(packed)) return packed;
  if (packed[0] === -1) return packed.slice(1).map(unpack);
  const keys = DATA.shapes[packed[0]], found = {};
  for (let n = 0; n < keys.length; n++) {
    Object.defineProperty(found, keys[n],
      { value: unpack(packed[n + 1]), enumerable: true, configurable: true, writable: true });
  }
  return found;
}

const bodies = [];

/** What only this kind of event has; a deadline counts from the event on. */
function body(row) {
  const place = ROW.body[row];
  return bodies[place] ??= unpack(DATA.rows.bodies[place]);
}

const text = (row) => DATA.rows.texts[ROW.text[row]];
const session = (row) => DATA.strings[ROW.session[row]];
const kind = (row) => KIND[DATA.rows.kinds[row]];
const hint = (row) => DATA.strings[ROW.hint[row]];
const station = (row) => LOGS[ROW.log[row]].station;

/** The whole event, as it stands in the log. */
function logged(row) {
  const [rule, phase, role] = hint(row);
  const found = { rec: "event", seq: ROW.line[row] - 1, t_ms: ROW.t[row], ev: kind(row), ...body(row) };
  if (found.deadline !== undefined) found.deadline += found.t_ms;
  for (const [name, value] of [["rule", rule], ["phase", phase], ["role", role]]) {
    if (value) found[name] = value;
  }
  return found;
}

/** Lists of five numbers as objects, with the row added up. */
function fives(numbers, make) {
  const found = [];
  let row = 0;
  for (let n = 0; n < numbers.length; n += 5) {
    row += numbers[n];
    found.push(make(row, numbers[n + 1], numbers[n + 2], numbers[n + 3], numbers[n + 4]));
  }
  return found;
}

const runOf = (row) => LOGS[ROW.log[row]].run;
const place = (at, row) => (at < 0 ? OTHERS[runOf(row)] : at);
const arrows = fives(DATA.arrows, (row, kind, down, from, to) =>
  ({ first: row, last: row + down, kind, from: place(from, row), to: place(to, row) }));
const bars = fives(DATA.bars, (row, down, how, ms, more) => ({
  first: row, last: down ? row + down : lastRow(row), open: !down, how, ms,
  spec: more === UNTOLD ? null : ms + more,
}));

/** The last row of the log to which a row belongs. */
function lastRow(row) {
  return rowsOf[ROW.log[row]].at(-1);
}

/** For each interval the highest end up to it: where a search backwards may stop. */
function reach(intervals) {
  let highest = -1;
  return intervals.map((one) => (highest = Math.max(highest, one.last)));
}

const arrowReach = reach(arrows), barReach = reach(bars);

/** The first row of a step. */
const rowOfStep = (step) => search(COUNT, (row) => STEP[row] >= step);
const STEPS_IN_ALL = COUNT ? STEP[COUNT - 1] + 1 : 0;

/** The first of `length` places for which `after` holds; it holds for all that follow. */
function search(length, after) {
  let low = 0, high = length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (after(middle)) high = middle;
    else low = middle + 1;
  }
  return low;
}

/** Every interval that touches the rows from `a` to `b`, also one that begins before and ends after. */
function touching(intervals, reached, a, b) {
  const found = [];
  let n = search(intervals.length, (i) => intervals[i].first > b) - 1;
  for (; n >= 0 && reached[n] >= a; n--) {
    if (intervals[n].last >= a) found.push(intervals[n]);
  }
  return found;
}

/* By log: the rows of the inputs of the steps that were followed. */
const STEPS = DATA.steps.map((steps) => {
  let line = 0;
  return steps.lines.map((more) => (line += more));
});
const CHANGES = DATA.steps.map((steps) => {
  const found = new Map();
  for (let n = 0; n < steps.states.length; n += 2) found.set(steps.states[n], steps.states[n + 1]);
  return found;
});
const KEYFRAME = 100;

/** The last step of a log at or before a row; -1 if there is none. */
function stepAt(log, row) {
  const rows = rowsOf[log];
  const n = search(rows.length, (i) => rows[i] > row);
  if (!n) return -1;
  const line = ROW.line[rows[n - 1]];
  return search(STEPS[log].length, (i) => STEPS[log][i] > line) - 1;
}

/** The state of a station after a step, and the names of what the step changed. */
function stateAfter(log, step) {
  const state = {};
  for (let n = step - (step % KEYFRAME); n <= step; n++) Object.assign(state, CHANGES[log].get(n));
  if (step % KEYFRAME && step > 0) return { state, changed: Object.keys(CHANGES[log].get(step) ?? {}) };
  const before = step > 0 ? stateAfter(log, step - 1).state : {};
  const differs = (name) => JSON.stringify(state[name]) !== JSON.stringify(before[name]);
  return { state, changed: step > 0 ? Object.keys(state).filter(differs) : [] };
}

/** The rule that decided a step, and the operator and line of Station.tla. */
function decision(log, step) {
  const [rule, operator, line] = DATA.strings[DATA.steps[log].where[step]];
  return { rule, operator, line };
}

const diverges = (row) => row === LOGS[ROW.log[row]].diverges;
/** Whether a row comes after the divergence of its log. */
const past = (row) => LOGS[ROW.log[row]].diverges >= 0 && row > LOGS[ROW.log[row]].diverges;
const firstDivergence = Math.min(...LOGS.map((log) => (log.diverges < 0 ? Infinity : log.diverges)));

/* Of two runs: where they first differ, and by log the one that it is compared with. */
const COMPARED = DATA.compared;
const DIFFERENCE = COMPARED?.stations[COMPARED.first]?.row ?? Infinity;
const MATE = LOGS.map(() => -1);
for (const { logs: [a, b] } of COMPARED?.stations ?? []) {
  MATE[a] = b;
  MATE[b] = a;
}

/** What the reason means for which the message of a row was rejected; empty if it was not. */
const cause = (row) => DATA.rejected[body(row).rejected] ?? "";

/** The causes in these logs. */
const CAUSES = [...new Set(Object.values(DATA.rejected))].sort();

/** What became of a message, in words. */
const became = ({ kind, last }) => (kind === REJECTED ? `rejected: ${body(last).rejected}` : ARROWS[kind]);

/** What became of the message of a row, in words. */
function fate(row) {
  const words = [];
  const found = arrowsFrom(row);
  for (const arrow of found.slice(0, 8)) words.push(`${became(arrow)} → ${COLUMNS[arrow.to].name}`);
  if (found.length > 8) words.push(`and ${found.length - 8} more`);
  return words.join(", ");
}

/** The arrows that leave at a row. */
function arrowsFrom(row) {
  const found = [];
  for (let n = search(arrows.length, (i) => arrows[i].first >= row); arrows[n]?.first === row; n++) {
    found.push(arrows[n]);
  }
  return found;
}
