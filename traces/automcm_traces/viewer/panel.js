/* Beside the drawing: the verdict, the selected step, the states, the specification. */

const panel = document.getElementById("panel");
const LONGEST = 2000;

/** Text from a log with what is not to be seen, or turns the line round, as escapes. */
function visible(value) {
  const full = String(value);
  const part = full.length > LONGEST ? full.slice(0, LONGEST) : full;
  const shown = part.replace(/[\p{C}\u2028\u2029]/gu, (c) =>
    `\\u${c.codePointAt(0).toString(16).padStart(4, "0")}`);
  return full.length > LONGEST ? `${shown}… (${full.length - LONGEST} more characters)` : shown;
}

/** An element; texts among the children stay text, whatever they hold. */
function el(name, attributes, ...children) {
  const element = document.createElement(name);
  for (const key in attributes) {
    if (key === "onclick") element.addEventListener("click", attributes[key]);
    else element.setAttribute(key, attributes[key]);
  }
  for (const child of children.flat()) {
    if (child === null || child === undefined || child === "") continue;
    element.append(child instanceof Node ? child : visible(child));
  }
  return element;
}

const link = (row, words) => el("button", { class: "link", onclick: () => select(row) }, words);
const folded = (title, open, ...children) => {
  const box = el("details", { class: "part" }, el("summary", {}, title), ...children);
  box.open = open;
  return box;
};

const WORDS = { allowed: "ALLOWED", diverges: "DIVERGES", cannot_tell: "CANNOT TELL",
  unreadable: "UNREADABLE", hazard: "ALLOWED, shows a hazard", violated: "VIOLATED" };
const SIGNS = { allowed: "✓", diverges: "✗", cannot_tell: "?", unreadable: "⚠", hazard: "⚠", violated: "✗" };

const badge = (verdict, ...more) =>
  el("span", { class: `badge ${verdict}` }, `${SIGNS[verdict]} ${WORDS[verdict]}`, ...more);

/** What weighs most of all verdicts on a run, as at the command line. */
function worst({ verdicts, system }) {
  const found = new Set(verdicts.map((v) => v.verdict));
  if (system?.verdict === "violated" && !found.has("diverges")) return "violated";
  for (const name of ["diverges", "unreadable", "cannot_tell"]) if (found.has(name)) return name;
  return system?.verdict === "hazard" ? "hazard" : "allowed";
}

const rowOf = (run, file, line) => {
  const log = LOGS.findIndex((one) => one.run === run && one.file === file);
  return log < 0 ? undefined : rowsOf[log].find((row) => ROW.line[row] === line);
};

function verdictOf(run, v) {
  const row = rowOf(run, v.file, v.line);
  const where = v.line ? `${v.file}:${v.line}` : v.file;
  const terms = [["event", v.event], ["expected", v.expected], [v.of_last_input ? "rule" : "last input decided by", v.guard || v.rule],
    ["nearest", v.nearest.replace(/^nearest allowed: /, "")], ["allowed after", v.allowed_after], ["state before", v.state],
    ["rejected", Object.entries(v.rejected).map(([reason, n]) => `${n} ${reason}`)], ["hint", v.hint], ["judged from", v.judged_from ? `line ${v.judged_from}` : ""],
    ["possible states", v.verdict === "allowed" && v.possible_states === 1 ? "" : v.possible_states],
    ["not logged", v.unobserved.join(", ")], ["warnings", v.warnings]];
  return el("div", { class: "verdict" },
    el("p", {}, badge(v.verdict), " ", row === undefined ? where : link(row, where)),
    definitions(terms),
    v.sessions.length ? folded(`${v.number_of_sessions} session${v.number_of_sessions > 1 ? "s" : ""}${v.number_of_sessions > v.sessions.length ? `, the last ${v.sessions.length}` : ""}`, false, el("ul", {}, v.sessions.map(sessionOf))) : "");
}

const sessionOf = (s) => el("li", {}, `${s.session.join("/")} as ${s.role}: ${s.phases.join(" › ")}`
  + (s.last ? `; lines ${s.first} to ${s.last}, ended by ${s.rule}` : `; from line ${s.first}, still in it`));

/** Each text on a line of its own. */
const lines = (texts) => texts.map((one) => el("div", {}, one));

/** Terms and what they are: a text, or some; those without are left out. */
function definitions(terms) {
  const list = el("dl", {});
  for (const [term, value] of terms) {
    if (value === "" || value.length === 0) continue;
    list.append(el("dt", {}, term), el("dd", {}, lines([value].flat())));
  }
  return list;
}

/** The row of a place in words, FILE:LINE; of an end that the log lacks, the last one. */
function placeOf(run, words) {
  const [, file, line] = /^(.+):(\d+)$/.exec(words) ?? [];
  const log = LOGS.findIndex((one) => one.run === run && one.file === file);
  return log < 0 ? undefined : rowsOf[log].findLast((row) => ROW.line[row] <= Number(line));
}

/** The row in which the first hazard begins. */
const firstHazard = Math.min(...RUNS.flatMap(({ system }, run) =>
  (system?.hazards ?? []).map((one) => placeOf(run, one.since) ?? Infinity)));

const firstWrong = firstDivergence !== Infinity ? firstDivergence : firstHazard;

/** A line of the report on a hazard; where it begins and ends leads there. */
function hazardLine(run, words) {
  const [, from] = /^\s*(?:from|to)\s+(.+?:\d+) \(/.exec(words) ?? [];
  const row = from === undefined ? undefined : placeOf(run, from);
  return row === undefined ? words : link(row, words);
}

function systemOf({ system: report, hazards }, run) {
  if (!report) return "";
  const judged = report.properties.map((p) => el("li", { class: p.outcome },
    `${{ holds: "✓", violated: "✗", cannot_tell: "?" }[p.outcome]} ${p.property} ${p.outcome.replace("_", " ")}`,
    p.outcome === "holds" ? "" : el("div", { class: "dim" }, lines(p.where.slice(0, 5)))));
  const lists = [["hazards", hazards.map((t) => el("li", {}, lines(t.split("\n").map((one) => hazardLine(run, one)))))], ["forged", report.forged.map((t) => el("li", {}, t))],
    ["received before sent", report.cycles.map((t) => el("li", {}, t))], ["properties", judged],
    ["notes", report.notices.map((t) => el("li", {}, t))]];
  return folded(el("span", {}, "All logs together ", badge(report.verdict)),
    !["allowed", "cannot_tell"].includes(report.verdict), report.problem ? el("p", {}, report.problem) : "",
    ...lists.filter(([, items]) => items.length).map(([name, items]) =>
      el("div", {}, el("h3", {}, name), el("ul", { class: "plain" }, items))));
}

const MOST_IN_MATRIX = 16;

/** By link how many messages were received, sent and lost. */
function linksOf({ system }) {
  const ways = Object.entries(system?.deliveries ?? {}).map(([way, counts]) => [way.split("-"), counts]);
  const names = [...new Set(ways.flatMap(([way]) => way))].slice(0, MOST_IN_MATRIX);
  if (!names.length) return "";
  const cell = (from, to) => {
    const [, counts] = ways.find(([way]) => way[0] === from && way[1] === to) ?? [];
    if (!counts) return el("td", {}, from === to ? "" : "–");
    const sent = Object.values(counts).reduce((sum, n) => sum + n, 0), { lost = 0, delivered = 0, duplicated = 0 } = counts;
    const all = Object.entries(counts).map(([name, n]) => `${n} ${name.replace("_", " ")}`).join(", ");
    return el("td", { title: `${from} to ${to}: ${all}` }, `${delivered + duplicated}/${sent}`,
      lost ? el("div", { class: "lost" }, `${lost} lost`) : "");
  };
  const part = folded("Links: received of sent", ways.some(([, counts]) => counts.lost), el("table", { class: "links" },
    el("tr", {}, el("th", {}, "from"), names.map((to) => el("th", { scope: "col" }, to))),
    names.map((from) => el("tr", {}, el("th", { scope: "row" }, from), names.map((to) => cell(from, to))))));
  part.classList.add("matrix");
  return part;
}

/** Any value as a tree; the fields named in `changed` are marked. */
function tree(value, changed, whole = false) {
  if (value === null || typeof value !== "object") {
    return el("span", { class: typeof value }, typeof value === "string" && !whole ? JSON.stringify(value) : String(value));
  }
  const entries = Object.entries(value);
  if (!entries.length) return el("span", { class: "dim" }, Array.isArray(value) ? "none" : "{}");
  if (Array.isArray(value) && value.length <= 4 && value.every((v) => typeof v === "number")) {
    return el("span", { class: "number" }, value.join(", "));
  }
  const list = el("ul", { class: "tree" });
  for (const [name, inner] of entries.slice(0, 200)) {
    const marked = changed.has(name);
    list.append(el("li", marked ? { class: "changed" } : {}, marked ? "▸ " : "",
      el("b", {}, name), " ", tree(inner, new Set(), whole)));
  }
  if (entries.length > 200) list.append(el("li", {}, `… ${entries.length - 200} more`));
  return list;
}

/** The other ends of what was sent or received at a row. */
function ends(row) {
  const found = [];
  for (const arrow of arrowsFrom(row).slice(0, 12)) {
    const words = `${became(arrow)} → ${COLUMNS[arrow.to].name}`;
    found.push(el("li", {}, arrow.last > row ? link(arrow.last, `${words}, step ${STEP[arrow.last] + 1}`) : words));
  }
  for (const arrow of touching(arrows, arrowReach, row, row)) {
    if (arrow.last !== row || arrow.first === row) continue;
    found.push(el("li", {}, link(arrow.first, `sent at step ${STEP[arrow.first] + 1}`), ` ${became(arrow)}`));
  }
  for (const bar of touching(bars, barReach, row, row)) {
    if (bar.first === row || (!bar.open && bar.last === row)) {
      const other = bar.first === row ? bar.last : bar.first;
      found.push(el("li", {}, said(bar), " ", bar.open ? "" : link(other, `step ${STEP[other] + 1}`)));
    }
  }
  return found.length ? el("ul", { class: "plain" }, found) : "";
}

/** Which run a row is of, before its words. */
const side = (row) => (TWO ? `${"AB"[runOf(row)]}: ` : "");

function stepPart(row) {
  const rows = atStep(row);
  return folded(`Step ${STEP[row] + 1}`, true,
    isFirst(row) ? el("p", { class: "differs" }, `≠ first difference, ${difference()}`) : "",
    rows.flatMap((one) => eventOf(one)),
    rows.map((one) => folded(`${side(one)}As logged`, false, tree(logged(one), new Set()))));
}

function eventOf(row) {
  const log = LOGS[ROW.log[row]];
  return [el("p", { class: "words" }, side(row) + text(row)),
    el("p", { class: "dim" }, `station ${log.station}, ${log.file}:${ROW.line[row]}, ${sinceStart(row)} ms from the start`
      + (ROW.t[row] === sinceStart(row) ? "" : `, t_ms ${ROW.t[row]}`)
      + (session(row) ? `, session ${session(row)}` : "")),
    past(row) ? el("p", { class: "warn" }, "after the divergence: not judged") : "",
    ends(row),
    contentOf(row).length > 2 ? el("button", { class: "copy", onclick: (click) => copyText(contentOf(row), click.target) }, "Copy message as JSON") : ""];
}

function roadPart(row) {
  const found = RUNS.map((_, run) => road(run, row)).filter(Boolean);
  const strips = found.flatMap(({ strip, told }, n) =>
    [strip, el("p", { class: "dim" }, (TWO ? `${"AB"[n]}: ` : "") + told.join("; "))]);
  return found.length ? folded("On the road", true, ...strips) : "";
}

/** The state of each station at a row; that of the row's own first, and of two runs both as one. */
function statePart(row) {
  const own = ROW.log[row];
  const order = [own, ...LOGS.keys()].filter((log, n) => n === 0 || (log !== own && log !== MATE[own]));
  const once = order.filter((log) => MATE[log] < 0 || log === own || LOGS[log].run === 0);
  return folded("State", true, ...once.slice(0, 20).map((log) => stateOf(log, row, log === own)));
}

/** The state of a station at a row, or why it has none. */
function known(log, row) {
  const step = stepAt(log, row);
  if (step >= 0) return { line: STEPS[log][step], ...stateAfter(log, step) };
  const yet = STEPS[log].length > 0;
  return { phase: yet ? "STANDALONE" : "not known", why: (!yet && LOGS[log].why_not) || "nothing has happened yet" };
}

function stateOf(log, row, open) {
  if (MATE[log] >= 0) return bothStates(...[log, MATE[log]].sort((a, b) => a - b), row, open);
  const { state, changed, line, phase, why } = known(log, row);
  const name = `station ${COLUMNS[log].name}`;
  if (!state) return folded(`${name}: ${phase}`, open, el("p", { class: "dim" }, why));
  const late = open && past(row) ? ", before the divergence" : "";
  return folded(`${name}: ${state.phase}`, open,
    el("p", { class: "dim" }, `after the step of line ${line}${late}; ▸ is what that step changed`),
    tree(state, new Set(changed), true));
}

/** The states of one station in both runs; what differs is told of both. */
function bothStates(a, b, row, open) {
  const [one, other] = [known(a, row), known(b, row)];
  const names = new Set([...Object.keys(one.state ?? {}), ...Object.keys(other.state ?? {})]);
  const list = el("ul", { class: "tree" });
  for (const name of names) {
    const [x, y] = [one.state?.[name], other.state?.[name]];
    const differ = one.state && other.state && JSON.stringify(x) !== JSON.stringify(y);
    const told = differ
      ? [el("div", {}, "A ", tree(x, new Set(), true)), el("div", {}, "B ", tree(y, new Set(), true))]
      : [tree(x ?? y, new Set(), true)];
    list.append(el("li", differ ? { class: "changed" } : {}, differ ? "≠ " : "", el("b", {}, name), " ", told));
  }
  const from = (found, run) => `${run} ${found.state ? `after the step of line ${found.line}` : found.why}`;
  const phases = [one, other].map((found) => found.state?.phase ?? found.phase);
  return folded(`station ${LOGS[a].station}: ${[...new Set(phases)].join(" | ")}`, open,
    el("p", { class: "dim" }, `${from(one, "A")}, ${from(other, "B")}; ≠ is what differs`), list);
}

/** The operator of Station.tla that decided the step, with its line. */
function specPart(row) {
  const told = atStep(row).map(specOf).filter(Boolean);
  return told.length > 1 && told[0].textContent === told[1].textContent ? [told[0]] : told;
}

function specOf(row) {
  const log = ROW.log[row], step = stepAt(log, row);
  if (step < 0) return "";
  const { rule, operator, line } = decision(log, step);
  const holding = Object.keys(DATA.operators).find((name) => holds(name, line)) ?? operator;
  const [first, source] = DATA.operators[holding] ?? [0, ""];
  const swaps = RUNS[runOf(row)].counterexample?.replaced ?? [];
  const own = swaps.filter((swap) => swap.operator === holding || swap.operator === operator);
  const inside = swaps.filter((swap) => !own.includes(swap) && new RegExp(`\\b${swap.operator}\\b`).test(source));
  if (own.length) return folded(`Specification of the model: ${rule || "no rule"}, ${own[0].by}`, true, own.map(modified));
  return folded(`Specification: ${rule || "no rule"}, ${operator}`, true,
    rule ? el("p", {}, `${rule}: ${DATA.rules[rule]} `, line ? el("span", { class: "dim" }, `Station.tla:${line}`) : "") : "",
    source ? el("ol", { class: "source" }, numberedLines(source, first, line)) : "", inside.map(modified));
}

const holds = (name, line) => {
  const [first, source] = DATA.operators[name];
  return line >= first && line < first + source.split("\n").length;
};

const closed = new Set();

/** Everything beside the drawing, for a row. Parts that were closed stay closed. */
function showPanel(row) {
  showTraffic(row);
  const parts = COUNT ? [stepPart(row), roadPart(row), statePart(row), ...specPart(row)] : [];
  document.getElementById("step").replaceChildren(...parts.filter(Boolean));
  for (const part of document.querySelectorAll("#step > details")) {
    const name = part.firstChild.textContent.split(/[ :]/)[0];
    if (closed.has(name)) part.open = false;
    part.addEventListener("toggle", () => (part.open ? closed.delete(name) : closed.add(name)));
  }
}

const short = (value) => {
  const told = value === null ? "absent" : typeof value === "string" ? value : JSON.stringify(value);
  return told.length > 60 ? `${told.slice(0, 60)}…` : told;
};

/** The first difference of two runs in words. */
function difference() {
  const one = COMPARED.stations[COMPARED.first], { a, b, fields } = one.difference;
  const told = fields.map((f) => `${f.field} ${short(f.a)} | ${short(f.b)}`).join(", ")
    || (a && b ? `${a.event} | ${b.event}` : `only ${a ? "A" : "B"}: ${(a ?? b).event}`);
  return visible(`station ${one.station}: ${told}`);
}

/** What a comparison says of one station. */
function comparedOf(one) {
  const [a, b] = one.logs.map((log) => LOGS[log].station), d = one.difference;
  const name = a === b ? String(a) : `${a} and ${b}`, steps = `${one.steps} step${one.steps === 1 ? "" : "s"}`;
  const at = (file, deed) => (deed ? `${file}:${deed.line}: ${deed.event}` : "nothing like it");
  const both = (fields) => fields.map((f) => `${f.field} ${short(f.a)} | ${short(f.b)}`);
  return el("div", { class: "verdict" },
    el("p", {}, d ? link(one.row, `${name}: differs after ${steps}`) : `${name}: the same, ${steps}`),
    definitions([["A", d ? at(one.a, d.a) : ""], ["B", d ? at(one.b, d.b) : ""], ["fields", d ? both(d.fields) : ""],
      ["parameters", both(one.parameters)], ["not compared", one.not_compared.join(", ")],
      ["times apart", one.times.apart_ms ? `up to ${one.times.apart_ms} ms` : ""]]));
}

const comparedBadge = () => (DIFFERENCE === Infinity
  ? el("span", { class: "badge allowed" }, "= the same")
  : el("span", { class: "badge differs" }, `≠ differ from step ${STEP[DIFFERENCE] + 1}`));

function comparison() {
  const only = [["A", COMPARED.only_a], ["B", COMPARED.only_b]].flatMap(([run, files]) =>
    files.map((file) => el("p", { class: "warn" }, `only ${run} has ${file}`)));
  const part = folded(el("span", {}, "A and B ", comparedBadge()), true,
    DIFFERENCE === Infinity ? el("p", {}, "No station that has a log in both does anything else in B than in A.") : "",
    COMPARED.stations.map(comparedOf), only);
  part.id = "compared";
  return part;
}

/* Of each counterexample its last row, after which the property is violated. */
const VIOLATIONS = RUNS.flatMap(({ counterexample: shown }, run) => {
  const row = Math.max(...LOGS.map((log, n) => (log.run === run ? rowsOf[n].at(-1) ?? -1 : -1)));
  return shown && row >= 0 ? [{ run, row, property: shown.property || shown.name }] : [];
});

/** What a counterexample shows: the mechanism taken away, and the property that breaks. */
function counterexampleOf({ counterexample: shown }, n) {
  if (!shown) return "";
  const last = VIOLATIONS.findIndex((one) => one.run === n);
  const part = folded(el("span", {}, "Counterexample ", el("span", { class: "badge violated" }, `✗ ${shown.property || shown.name}`)), true,
    el("p", { class: "words" }, shown.why),
    definitions([["violates", `${shown.property} (${shown.name})`], ["model", shown.model], ["changed", shown.changes]]),
    el("p", {}, link(VIOLATIONS[last]?.row ?? 0, `in the last of ${shown.states} states`)),
    ...shown.replaced.map(modified));
  part.id = "counterexample";
  return part;
}

/** The operator that replaces another in a model. */
function modified({ operator, by, module, line: first, text: source }) {
  return folded(`${operator} is replaced by ${by}${module && ` (${module}.tla:${first})`}`, true,
    source ? el("ol", { class: "source modified" }, numberedLines(source, first, -1)) : "");
}

const numberedLines = (source, first, line) => source.split("\n").map((words, n) =>
  el("li", first + n === line ? { class: "here" } : {},
    el("span", { class: "number" }, `${first + n}`.padStart(4)), first + n === line ? " ▸ " : "   ", words));

function judgedOf(run, n) {
  const part = folded(TWO ? el("span", {}, `Verdict on ${"AB"[n]} `, badge(worst(run))) : "Verdict", true,
    ...verdictsOf(run, n), systemOf(run, n), linksOf(run));
  part.id = `judged${n || ""}`;
  return part;
}

/** The verdicts on the logs of a run; if all are allowed, in one line. */
function verdictsOf({ verdicts }, n) {
  const each = verdicts.slice(0, 20).map((v) => verdictOf(n, v));
  const plain = ({ verdict, warnings, hint }) => verdict === "allowed" && !warnings.length && !hint;
  if (verdicts.length < 2 || !verdicts.every(plain)) return each;
  return [folded(el("span", {}, badge("allowed"), ` ${verdicts.length} logs`), false, ...each)];
}

/** How many messages a run has, and how many of their deliveries were lost. */
function countsOf(run) {
  const own = arrows.filter((arrow) => COLUMNS[arrow.from].run === run);
  const lost = own.filter(({ kind }) => kind === LOST).length;
  return [el("span", { class: "dim" }, `${grouped(own.length)} deliveries, `),
    el("span", { class: lost ? "lost" : "dim" }, `${grouped(lost)} lost`)];
}

/** Of a counterexample the property that it violates. */
const broken = ({ counterexample: shown }) => (shown
  ? [el("span", { class: "badge violated" }, `✗ VIOLATES ${shown.property || shown.name} without a mechanism`), " "] : []);

function buildPanel() {
  const top = document.getElementById("verdict");
  const badges = RUNS.map((run, n) => [TWO ? `${"AB"[n]} ` : "", ...broken(run), badge(worst(run)), " ", ...countsOf(n), " "]);
  top.replaceChildren(el("span", {}, badges.flat(), TWO ? comparedBadge() : ""));
  const note = el("p", { id: "note", class: "warn" }, DATA.note);
  if (DATA.note) panel.append(DATA.note.length < 400 ? note : folded("A part of the logs is shown", false, note));
  panel.append(...RUNS.map(counterexampleOf).filter(Boolean), TWO ? comparison() : "", ...RUNS.map(judgedOf), el("div", { id: "step" }));
}
