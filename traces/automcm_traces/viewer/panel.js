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

/** What weighs most of all verdicts, as at the command line. */
function worst() {
  const found = new Set(DATA.verdicts.map((v) => v.verdict));
  if (DATA.system?.verdict === "violated" && !found.has("diverges")) return "violated";
  for (const name of ["diverges", "unreadable", "cannot_tell"]) if (found.has(name)) return name;
  return DATA.system?.verdict === "hazard" ? "hazard" : "allowed";
}

const rowOf = (file, line) => {
  const log = LOGS.findIndex((one) => one.file === file);
  return log < 0 ? undefined : rowsOf[log].find((row) => ROW.line[row] === line);
};

function verdictOf(v) {
  const row = rowOf(v.file, v.line);
  const where = v.line ? `${v.file}:${v.line}` : v.file;
  const terms = [["event", v.event], ["expected", v.expected], ["rule", v.guard || v.rule],
    ["nearest", v.nearest], ["allowed after", v.allowed_after], ["state before", v.state],
    ["possible states", v.verdict === "allowed" && v.possible_states === 1 ? "" : v.possible_states],
    ["not logged", v.unobserved.join(", ")], ["warnings", v.warnings]];
  return el("div", { class: "verdict" },
    el("p", {}, badge(v.verdict), " ", row === undefined ? where : link(row, where)),
    definitions(terms),
    v.sessions.length ? folded(`${v.sessions.length} session${v.sessions.length > 1 ? "s" : ""}`, false, el("ul", {}, v.sessions.map(sessionOf))) : "");
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

function systemOf(report) {
  if (!report) return "";
  const judged = report.properties.map((p) => el("li", { class: p.outcome },
    `${{ holds: "✓", violated: "✗", cannot_tell: "?" }[p.outcome]} ${p.property} ${p.outcome.replace("_", " ")}`,
    p.outcome === "holds" ? "" : el("div", { class: "dim" }, lines(p.where.slice(0, 5)))));
  const ways = Object.entries(report.deliveries).map(([way, counts]) => el("li", {}, `${way}: `
    + Object.entries(counts).map(([name, n]) => `${n} ${name.replace("_", " ")}`).join(", ")));
  const lists = [["hazards", DATA.hazards.map((t) => el("li", {}, lines(t.split("\n"))))], ["forged", report.forged.map((t) => el("li", {}, t))],
    ["received before sent", report.cycles.map((t) => el("li", {}, t))], ["properties", judged],
    ["messages", ways], ["notes", report.notices.map((t) => el("li", {}, t))]];
  return folded(el("span", {}, "All logs together ", badge(report.verdict)),
    !["allowed", "cannot_tell"].includes(report.verdict), report.problem ? el("p", {}, report.problem) : "",
    ...lists.filter(([, items]) => items.length).map(([name, items]) =>
      el("div", {}, el("h3", {}, name), el("ul", { class: "plain" }, items))));
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
    const words = `${ARROWS[arrow.kind]} → ${COLUMNS[arrow.to].name}`;
    found.push(el("li", {}, arrow.last > row ? link(arrow.last, `${words}, step ${arrow.last + 1}`) : words));
  }
  for (const arrow of touching(arrows, arrowReach, row, row)) {
    if (arrow.last !== row || arrow.first === row) continue;
    found.push(el("li", {}, link(arrow.first, `sent at step ${arrow.first + 1}`), ` ${ARROWS[arrow.kind]}`));
  }
  for (const bar of touching(bars, barReach, row, row)) {
    if (bar.first === row || (!bar.open && bar.last === row)) {
      const other = bar.first === row ? bar.last : bar.first;
      found.push(el("li", {}, said(bar), " ", bar.open ? "" : link(other, `step ${other + 1}`)));
    }
  }
  return found.length ? el("ul", { class: "plain" }, found) : "";
}

function stepPart(row) {
  const log = LOGS[ROW.log[row]];
  return folded(`Step ${row + 1}`, true,
    el("p", { class: "words" }, text(row)),
    el("p", { class: "dim" }, `station ${log.station}, ${log.file}:${ROW.line[row]}, ${ROW.t[row]} ms`
      + (session(row) ? `, session ${session(row)}` : "")),
    past(row) ? el("p", { class: "warn" }, "after the divergence: not judged") : "",
    ends(row), folded("As logged", false, tree(logged(row), new Set())));
}

function roadPart(row) {
  const found = road(row);
  return found ? folded("On the road", true, found.strip, el("p", { class: "dim" }, found.told.join("; "))) : "";
}

/** The state of each station at a row; that of the row's own first. */
function statePart(row) {
  const own = ROW.log[row];
  const order = [own, ...LOGS.keys()].filter((log, n) => n === 0 || log !== own).slice(0, 20);
  return folded("State", true, ...order.map((log) => {
    const step = stepAt(log, row);
    const name = `station ${LOGS[log].station}`;
    if (step < 0) {
      const why = STEPS[log].length ? "nothing has happened yet" : LOGS[log].why_not || "nothing has happened yet";
      return folded(`${name}: ${STEPS[log].length ? "STANDALONE" : "not known"}`, log === own, el("p", { class: "dim" }, why));
    }
    const { state, changed } = stateAfter(log, step);
    const late = log === own && past(row) ? ", before the divergence" : "";
    return folded(`${name}: ${state.phase}`, log === own,
      el("p", { class: "dim" }, `after the step of line ${STEPS[log][step]}${late}; ▸ is what that step changed`),
      tree(state, new Set(changed), true));
  }));
}

/** The operator of Station.tla that decided the step, with its line. */
function specPart(row) {
  const log = ROW.log[row], step = stepAt(log, row);
  if (step < 0) return "";
  const { rule, operator, line } = decision(log, step);
  const holding = Object.keys(DATA.operators).find((name) => holds(name, line)) ?? operator;
  const [first, source] = DATA.operators[holding] ?? [0, ""];
  const numbered = source.split("\n").map((words, n) => el("li", first + n === line ? { class: "here" } : {},
    el("span", { class: "number" }, `${first + n}`.padStart(4)), first + n === line ? " ▸ " : "   ", words));
  return folded(`Specification: ${rule || "no rule"}, ${operator}`, true,
    rule ? el("p", {}, `${rule}: ${DATA.rules[rule]} `, line ? el("span", { class: "dim" }, `Station.tla:${line}`) : "") : "",
    source ? el("ol", { class: "source" }, numbered) : "");
}

const holds = (name, line) => {
  const [first, source] = DATA.operators[name];
  return line >= first && line < first + source.split("\n").length;
};

const closed = new Set();

/** Everything beside the drawing, for a row. Parts that were closed stay closed. */
function showPanel(row) {
  const parts = COUNT ? [stepPart(row), roadPart(row), statePart(row), specPart(row)] : [];
  document.getElementById("step").replaceChildren(...parts.filter(Boolean));
  for (const part of document.querySelectorAll("#step > details")) {
    const name = part.firstChild.textContent.split(/[ :]/)[0];
    if (closed.has(name)) part.open = false;
    part.addEventListener("toggle", () => (part.open ? closed.delete(name) : closed.add(name)));
  }
}

function buildPanel() {
  const top = document.getElementById("verdict");
  top.className = `badge ${worst()}`;
  top.textContent = `${SIGNS[worst()]} ${WORDS[worst()]}`;
  const verdicts = DATA.verdicts.map(verdictOf);
  const judged = folded("Verdict", true, ...verdicts.slice(0, 20), systemOf(DATA.system));
  judged.id = "judged";
  panel.append(judged, el("div", { id: "step" }));
}
