/* The heads of the columns: names, phases at the top of the window, and how to move and widen them. */

const NARROWEST = 24, GRIP = 5;

function heads(seen, first, at, size) {
  const group = make("g", { class: "heads" });
  group.append(make("rect", { class: "cover", x: 0, y: 0, width: size.width, height: HEAD - 2 }));
  const inner = make("g", { transform: `translate(${-at.left} 0)` });
  for (let n = 0; n < COLUMNS.length; n++) {
    if (seen[n]) inner.append(head(n, first));
  }
  if (TWO) RUNS.forEach((_, run) => inner.append(make("text", { class: "unit", x: layout.text[run], y: 24 }, "AB"[run])));
  group.append(inner);
  group.append(make("rect", { class: "cover", x: 0, y: 0, width: fixedWidth() - (TWO ? 6 : 0), height: HEAD - 2 }));
  const unit = (x, words, anchor = "end") => group.append(make("text", { x, y: 24, "text-anchor": anchor, class: "unit" }, words));
  if (layout.step) unit(layout.step - 8, "step");
  unit(layout.gutter - 10, now.logged ? "t_ms" : "ms");
  if (!TWO) unit(layout.text[0], "event", "start");
  group.append(make("line", { class: "rule", x1: 0, x2: size.width, y1: HEAD - 2, y2: HEAD - 2 }));
  return group;
}

function head(n, first) {
  const { logged, name } = COLUMNS[n], width = layout.width[n], x = layout.x[n];
  const short = name.replace(/^[AB] · /, "");
  const shown = logged ? short : short + (OTHERS.includes(n) ? "" : "?");
  const group = make("g", { class: "column" });
  const phase = logged ? phaseAt(n, first) : "";
  const full = whole(COLUMNS[n], shown);
  group.append(make("title", {}, visible(phase ? `${full}: ${phase}` : full)));
  const fits = [full, ...full.split(" · "), COLUMNS[n].called].find((one) => one && textWidth(one) * 1.13 < width - 4) ?? shown;
  group.append(make("text", { x: x + width / 2, y: 16, "text-anchor": "middle",
    class: logged ? "name" : "name bare" }, fitted(visible(fits), (width - 4) / (logged ? 1.13 : 1))));
  if (phase && phase !== "STANDALONE") {
    group.append(make("rect", { class: `chip ${phase.toLowerCase().replace(/[^a-z]/g, "")}`, x: x + 4, y: 22,
      width: width - 8, height: 12, rx: 3 }));
    if (textWidth(phase) < width) {
      group.append(make("text", { class: "phase-name", x: x + width / 2, y: 32, "text-anchor": "middle" }, visible(phase)));
    }
  }
  group.append(make("path", { class: "grip", d: `M${x + width} 6v${HEAD - 14}` }));
  return group;
}

/** The name of a column with its number and role. */
function whole({ called, roles }, number) {
  const name = called ? `${called} (${number})` : number;
  return roles && roles !== called ? `${name} · ${roles}` : name;
}

/** What is at a place of the heads: the edge of a column or of the words, or a column. */
function headAt(x) {
  const inside = x + view.scrollLeft, fixed = TWO ? inside : x;
  const ends = layout.text.findIndex((left) => Math.abs(left + layout.words - fixed) <= GRIP);
  if (ends >= 0) return { words: ends };
  const edge = COLUMNS.findIndex((_, n) => layout.width[n] && Math.abs(layout.x[n] + layout.width[n] - inside) <= GRIP);
  if (edge >= 0) return { edge };
  const column = COLUMNS.findIndex((_, n) => inside >= layout.x[n] && inside < layout.x[n] + layout.width[n]);
  return column >= 0 && x > fixedWidth() - (TWO ? layout.words : 0) ? { column } : {};
}

function widen(column, width) {
  now.widths.set(column, Math.max(NARROWEST, Math.min(900, width)));
  resize();
}

function widenWords(width) {
  now.words = Math.max(90, Math.min(900, width));
  resize();
}

/** Put a column so many places on, within its run. */
function moveColumn(column, by) {
  const order = now.order[COLUMNS[column].run], seen = order.filter((n) => layout.width[n]);
  const next = seen[seen.indexOf(column) + by];
  if (next === undefined) return;
  const to = order.indexOf(next);
  order.splice(order.indexOf(column), 1);
  order.splice(to, 0, column);
  resize();
}

/** The column of the selected event, as the keys move and widen it. */
const ownColumn = () => ROW.log[now.row];

function resetColumns() {
  now.order = columnsOfRuns();
  now.widths.clear();
  now.words = 0;
  resize();
}

/** Follow a pointer that took hold of the heads. */
function dragHead(press) {
  const held = headAt(press.offsetX), begun = press.clientX;
  if (held.words !== undefined) {
    const width = layout.words;
    return follow(press, (move) => widenWords(width + move.clientX - begun));
  }
  if (held.edge !== undefined) {
    const width = layout.width[held.edge];
    return follow(press, (move) => widen(held.edge, width + move.clientX - begun));
  }
  if (held.column === undefined) return undefined;
  return follow(press, (move) => {
    const under = headAt(move.clientX - view.getBoundingClientRect().left).column;
    if (under === undefined || under === held.column || COLUMNS[under].run !== COLUMNS[held.column].run) return;
    const middle = lifeline(under) - view.scrollLeft + view.getBoundingClientRect().left;
    const rightwards = layout.x[under] > layout.x[held.column];
    if (rightwards === move.clientX > middle) moveColumn(held.column, rightwards ? 1 : -1);
  });
}

/** Call `moved` for each movement until the pointer is let go, then `done`. */
function follow(press, moved, done = () => {}) {
  svg.setPointerCapture(press.pointerId);
  svg.onpointermove = moved;
  svg.onpointerup = svg.onpointercancel = (end) => {
    svg.onpointermove = point;
    svg.onpointerup = svg.onpointercancel = null;
    done(end);
  };
}

/** The pointer shows what it would take hold of. */
function point(move) {
  const held = move.offsetY < HEAD ? headAt(move.offsetX) : {};
  svg.style.cursor = held.edge !== undefined || held.words !== undefined ? "col-resize"
    : held.column !== undefined ? "grab" : "";
}
