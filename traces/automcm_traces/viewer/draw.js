/* The space-time drawing: only what is in the window is in the document. */

function make(name, attributes, ...children) {
  const element = document.createElementNS(SVG, name);
  for (const key in attributes) element.setAttribute(key, attributes[key]);
  element.append(...children);
  return element;
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
  const layers = ["bands", "phases", "lines", "bars", "arrows", "marks"].map((name) => make("g", { class: name }));
  const [bands, phases, lines, barLayer, arrowLayer, marks] = layers;
  const moved = make("g", { transform: `translate(${-at.left} 0)` }, ...layers);
  const fixed = make("g", {});
  const seen = COLUMNS.map((one, n) => layout.width[n] > 0
    && layout.x[n] + layout.width[n] > at.left && layout.x[n] < at.left + size.width);
  if (b > a) {
    drawBands(bands, a, b, y, at, size);
    drawPhases(phases, first, last, y, seen, size.height);
    drawHazards(phases, marks, y, seen, size);
    for (let n = 0; n < COLUMNS.length; n++) {
      if (seen[n]) lines.append(...lifelineOf(n, y, size.height));
    }
    for (const bar of touching(bars, barReach, first, last)) {
      if (seen[ROW.log[bar.first]] && passesBar(bar)) drawBar(barLayer, bar, at, size.height);
    }
    const signs = [], labels = [];
    for (const arrow of touching(arrows, arrowReach, first, last)) {
      if (passesArrow(arrow)) drawArrow(arrowLayer, arrow, y, signs, labels);
    }
    labelArrows(labels, signs);
    drawDue(arrowLayer, y);
    if (now.time) drawRuler(lines, at, size);
    drawMarks(marks, a, b, y, seen);
    if (TWO) lines.append(divide(size));
    drawDifference(fixed, y, size);
    drawSpan(fixed, y, size);
  }
  svg.setAttribute("width", size.width);
  svg.setAttribute("height", size.height);
  svg.replaceChildren(moved, gutter(a, b, y, at, size), fixed, heads(seen, first, at, size));
  showWindow();
}

/** An arrow is drawn where one of its ends is shown; the row of a folded copy stands for it. */
const passesArrow = (arrow) => isShown(arrow.first) || isShown(arrow.last);
/** A bar is drawn although the rows of its timer are not shown. */
const passesBar = (bar) => (filters.cams.checked || !(ROW.flags[bar.first] & OF_CAM))
  && (!filters.station.value || station(bar.first) === Number(filters.station.value));

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
    if (!now.time) layer.append(make("path", { class: "guide", d: `M${whole[0]} ${y(row) + HEIGHT / 2}h${whole[1]}` }));
  }
}

/** What divides two runs. */
function divide(size) {
  const x = layout.spans[1][0] - DIVIDE / 2;
  return make("line", { class: "divide", x1: x, x2: x, y1: HEAD, y2: size.height });
}

/** The line above the first difference of two runs, with what it is in words. */
function drawDifference(layer, y, size) {
  if (DIFFERENCE === Infinity || (now.span && (DIFFERENCE < now.span[0] || DIFFERENCE > now.span[1]))) return;
  const middle = y(DIFFERENCE) - HEIGHT;
  if (middle < HEAD || middle > size.height + HEIGHT) return;
  layer.append(make("rect", { class: "differs", x: 0, y: middle - HEIGHT / 2 + 1, width: size.width, height: HEIGHT - 2 }));
  layer.append(make("text", { class: "differs", x: 10, y: middle + 4 },
    fitted(`≠ first difference, ${difference()}`, (size.width - 20) / 1.12)));
}

/** The lifeline of a column; that of a log without an end stops with a †. */
function lifelineOf(column, y, height) {
  const x = lifeline(column), { logged } = COLUMNS[column], end = logged && rowsOf[column].at(-1);
  const stops = logged && ["no end", "crash"].includes(LOGS[column].end) && end !== undefined;
  const y2 = stops ? Math.min(height, y(end) + HEIGHT / 2) : height, drawn = [];
  if (y2 > HEAD) drawn.push(make("line", { class: logged ? "life" : "life bare", x1: x, x2: x, y1: HEAD, y2 }));
  if (stops && y2 < height && y2 > HEAD) {
    drawn.push(make("text", { class: "stops", x, y: y2 + 12, "text-anchor": "middle" },
      make("title", {}, `the log of station ${COLUMNS[column].name} stops here`), "†"));
  }
  return drawn;
}

/* The hazards of the runs: the rows in which they begin and end, and the two columns. */
const HAZARDS = RUNS.flatMap(({ system }, run) => (system?.hazards ?? []).flatMap((one) => {
  const ends = [one.since, one.until].map((at) => placeOf(run, at));
  const columns = [one.prescriber, one.target].map((station) =>
    COLUMNS.findIndex((column) => column.run === run && column.station === station));
  return ends.includes(undefined) || columns.includes(-1) ? [] : [{ ...one, ends, columns }];
}));

/** A band over the two stations of a hazard, from its begin to its end, with its bound. */
function drawHazards(layer, marks, y, seen, size) {
  for (const hazard of HAZARDS) {
    const [top, bottom] = hazard.ends.map(y), about = hazardWords(hazard);
    if (bottom < HEAD || top > size.height) continue;
    const group = make("g", { class: `hazard ${hazard.outcome}` }, make("title", {}, about));
    for (const n of hazard.columns) {
      if (seen[n]) {
        group.append(make("rect", { x: layout.x[n] + 1, y: Math.max(top, HEAD - 4), width: layout.width[n] - 2,
          height: Math.max(3, bottom - Math.max(top, HEAD - 4)) }));
      }
    }
    layer.append(group);
    const [acts, left] = hazard.columns, beside = layout.x[left] === layout.x[acts] + layout.width[acts];
    const room = (beside ? lifeline(left) - layout.x[acts] : layout.width[acts]) - 18, ms = grouped(hazard.length?.ms ?? 0), most = hazard.bound_ms;
    const words = [about, `⚠ ${ms} of ${most ? grouped(most) : "?"} ms`, `⚠ ${ms} ms`, "⚠"]
      .find((one) => textWidth(one) * 1.15 < room) ?? "";
    marks.append(make("text", { class: "hazard-words", x: layout.x[acts] + 8, y: Math.max(top, HEAD) + 14 }, words));
  }
}

/** How long a hazard lasts, and its bound. */
function hazardWords({ length, bound_ms: bound, outcome, open }) {
  const lasts = length ? `${open ? "at least " : ""}${grouped(length.ms)} ms` : "of unknown length";
  const most = { within: " of at most", exceeds: ", exceeds", cannot_tell: ", bound" }[outcome];
  return `⚠ hazard ${lasts}${bound === undefined || bound === null ? "" : `${most} ${grouped(bound)} ms`}`;
}

/** Where a log diverges because a message is missing: the arrow that was due. */
function drawDue(layer, y) {
  LOGS.forEach(({ due, diverges, run }, log) => {
    if (diverges < 0 || !isShown(diverges)) return;
    due.forEach(([type, station], n) => {
      const found = COLUMNS.findIndex((column) => column.run === run && column.station === station);
      const to = found < 0 ? OTHERS[run] : found, side = to < log && layout.width[to] ? -1 : 1;
      const end = layout.width[to] ? lifeline(to) - side * 5 : lifeline(log) + layout.width[log] / 2 - 4;
      const at = y(diverges) + HEIGHT * (n + 0.7), words = `${type} was due`;
      const group = make("g", { class: "arrow due" }, make("title", {}, `missing: ${type} to ${station || "all"}`));
      line(group, lifeline(log) + side * 5, at, end, at, true);
      group.append(make("text", { class: "label", x: lifeline(log) + side * 12, y: at - 4,
        "text-anchor": side > 0 ? "start" : "end" }, words));
      layer.append(group);
    });
  });
}

/** A timer from arming to its end; a tick where the specification has its deadline. */
function drawBar(layer, bar, at, height) {
  const column = ROW.log[bar.first], room = Math.max(1, Math.floor((layout.width[column] / 2 - 13) / LANE));
  const x = lifeline(column) - 8 - Math.min(room, lanes.get(bar) + 1) * LANE;
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

/** An arrow; one that arrives nowhere is short. `signs` are those drawn so far; they may not overlap. */
function drawArrow(layer, arrow, y, signs, labels) {
  const { kind } = arrow, from = lifeline(arrow.from), to = lifeline(arrow.to);
  const height = (row) => y(isShown(row) ? row : headOf(row));
  const group = make("g", { class: `arrow ${ARROWS[kind].replace(" ", "-")}` });
  if (past(arrow.first) || past(arrow.last)) group.classList.add("past");
  if (isDimmed(arrow.first)) group.classList.add("dimmed");
  group.dataset.row = arrow.first;
  group.append(make("title", {}, `${became(arrow)}: ${text(arrow.first)}`));
  const y1 = height(arrow.first), side = Math.sign(to - from) || 1;
  const x1 = from + side * 5;
  const signed = (x, word) => {
    if (y1 < HEAD + 8 || signs.some((one) => one.x === x && Math.abs(one.y - y1) < 15)) return;
    signs.push({ x, y: y1 });
    sign(group, x, y1, word);
  };
  if (kind === DELIVERED || kind === DUPLICATE || kind === OVERHEARD) {
    line(group, x1, y1, to - side * 5, height(arrow.last), true);
  } else if (kind === SENDER_UNOBSERVED || kind === FORGED) {
    line(group, from + side * 8, y1, to - side * 5, y1, true);
    signed(from, kind === FORGED ? "!" : "?");
  } else if (kind === REJECTED) {
    const y2 = height(arrow.last);
    group.classList.add(cause(arrow.last));
    stopped(group, x1, y1, to - side * 9, y2);
    if (y2 >= HEAD + 8) {
      signs.push({ x: to - side * 17, y: y2 - 8 });
      sign(group, to - side * 17, y2 - 8, initial(cause(arrow.last)));
    }
  } else if (kind === UNOBSERVED) {
    line(group, x1, y1, to - side * 9, y1, false);
    signed(to, "?");
  } else {
    const x2 = from + (to - from) * 0.55, y2 = y1 + HEIGHT * 0.7;
    if (kind === IN_FLIGHT) fading(group, x1, y1, x2, y2);
    else line(group, x1, y1, x2 - side * 4, y2, false);
    if (kind === LOST) {
      signs.push({ x: x2, y: y2 });
      cross(group, x2, y2);
    }
  }
  if (kind !== OVERHEARD && kind !== SENDER_UNOBSERVED && kind !== FORGED) labels.push({ group, arrow, x: x1, y: y1, side });
  layer.append(group);
}

/** The types of messages where their arrows begin, if there is room; once for each that was sent. */
function labelArrows(wanted, signs) {
  const placed = [];
  for (const { group, arrow, x, y, side } of wanted) {
    const type = typeOf(arrow.first), wide = textWidth(type), left = side > 0 ? x + 8 : x - 8 - wide;
    const narrow = wide + 22 > Math.abs(lifeline(arrow.to) - x) || y < HEAD + 12;
    const taken = placed.some((one) => one.row === arrow.first
      || (Math.abs(one.y - y) < 14 && one.left < left + wide && left < one.left + one.wide));
    const signed = signs.some((one) => Math.abs(one.y - y + 4) < 16 && one.x > left - 8 && one.x < left + wide + 8);
    if (!type || narrow || taken || signed) continue;
    placed.push({ row: arrow.first, y, left, wide });
    group.append(make("text", { class: "label", x: left, y: y - 4 }, type));
  }
}

function line(group, x1, y1, x2, y2, pointed) {
  group.append(make("line", { x1, y1, x2, y2 }));
  if (!pointed) return;
  const turn = (Math.atan2(y2 - y1, x2 - x1) * 180) / Math.PI;
  group.append(make("path", { class: "head", d: "M0 0L-9 -4.5L-9 4.5Z",
    transform: `translate(${x2} ${y2}) rotate(${turn})` }));
}

/** The letter of a cause. */
const initial = (name) => name[0].toUpperCase();

/** A line that ends in a bar. */
function stopped(group, x1, y1, x2, y2) {
  line(group, x1, y1, x2, y2, false);
  group.append(make("path", { class: "cross", d: `M${x2} ${y2 - 6}v12` }));
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

const styleOf = (row) =>
  `${kind(row)}${cause(row) && " rejected"}${past(row) ? " past" : ""}${isDimmed(row) ? " dimmed" : ""}`;

/** Of each row a mark on its lifeline. */
function drawMarks(layer, a, b, y, seen) {
  for (const row of now.shown.slice(a, b).flatMap(abreast)) {
    const column = ROW.log[row];
    if (!seen[column]) continue;
    layer.append(make("g", { class: `row ${styleOf(row)}`, "data-row": row },
      make("title", {}, rowText(row)),
      make("path", { class: "mark", d: MARKS[kind(row)], transform: `translate(${lifeline(column)} ${y(row)})` })));
  }
}

/** A row in words, with its station, and the phase in which it leaves the station. */
function rowText(row) {
  const phase = phaseChange(row), whose = LOGS.length > RUNS.length ? `${station(row)} ` : "";
  const broken = VIOLATIONS.find((one) => one.row === row);
  return (diverges(row) ? "✗ " : "") + whose + text(row) + forWhom(row) + (phase ? ` = ${visible(phase)}` : "")
    + (broken ? ` ✗ ${broken.property} is violated` : "");
}

/** For whom a message is, if the station overhears it. */
function forWhom(row) {
  const to = kind(row) === "receive" && body(row).message?.dst;
  return Number.isInteger(to) && to !== station(row) ? ` for ${to}` : "";
}

/** The words of a row, with how often it is there, where copies are folded. */
function words(row, y, at) {
  const run = runOf(row), copied = times(row), missed = lossesOf(row) ? `${lossesOf(row)} lost` : "";
  const tail = [copied, missed].reduce((wide, one) => wide + (one ? textWidth(one) * 1.1 + 8 : 0), 0);
  const x = layout.text[run] - (TWO ? at.left : 0);
  const group = make("g", { class: `row ${styleOf(row)}`, "data-row": row });
  const full = rowText(row), shown = fitted(full, layout.words - 12 - tail);
  const element = make("text", { x, y: y + 4 }, shown);
  if (shown !== full) group.append(make("title", {}, full));
  group.append(element);
  if (copied) {
    group.append(make("text", { class: "copies", x: x + textWidth(shown) + 8, y: y + 4 }, copied));
  }
  if (missed) {
    const before = textWidth(shown) + 8 + (copied ? textWidth(copied) * 1.1 + 8 : 0);
    group.append(make("text", { class: "lost", x: x + before, y: y + 4 }, missed));
  }
  return group;
}

/** Numbers of the steps, times, and what happened in words, left of the columns. */
function gutter(a, b, y, at, size) {
  const group = make("g", { class: "gutter" });
  const cover = make("g", { class: "covers" });
  if (at.left > 0) cover.append(make("rect", { class: "cover", x: 0, y: 0, width: fixedWidth(), height: size.height }));
  group.append(cover);
  let free = -Infinity, more = 0;
  const close = () => {
    if (more && !TWO) besides(group.lastChild, more);
    more = 0;
  };
  for (let n = a; n < b; n++) {
    const row = now.shown[n], chosen = row === now.row;
    if (y(row) < HEAD) continue;
    if (y(row) - free < 15) {
      more++;
      if (!chosen) continue;
      group.lastChild.remove();
    } else {
      close();
    }
    free = y(row);
    const line = make("g", { class: chosen ? "step selected" : "step" });
    const same = { y: y(row) + 4, "text-anchor": "end" };
    if (layout.step) line.append(make("text", { class: "number", x: layout.step - 8, ...same }, String(STEP[row] + 1)));
    line.append(make("text", { class: "time", x: layout.gutter - 10, ...same }, timeText(row)));
    line.append(...abreast(row).map((one) => words(one, y(row), at)));
    group.append(line);
  }
  close();
  return group;
}

/** After the words of a step, how many more stand where it stands, in real time. */
function besides(line, more) {
  const texts = line.querySelectorAll("text"), last = texts[texts.length - 1];
  const bold = last.matches(".copies, .lost") ? 1.1 : 1;
  const x = Number(last.getAttribute("x")) + textWidth(last.textContent) * bold + 8;
  if (x + 30 < layout.text[0] + layout.words) {
    line.append(make("text", { class: "more", x, y: last.getAttribute("y") }, `+${more}`));
  }
}
