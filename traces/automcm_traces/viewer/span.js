/* A span of rows, from the mark to the selected row: how long it lasts, and the drawing of it alone. */

/** First and last row of the span; null without a mark. */
function spanRows() {
  if (now.mark < 0 || now.mark === now.row) return null;
  return [Math.min(now.mark, now.row), Math.max(now.mark, now.row)];
}

/** The ms between two rows: of one log on its clock, else on the clock of the first log. */
function between([a, b]) {
  return ROW.log[a] === ROW.log[b] ? ROW.t[b] - ROW.t[a] : TIME[b] - TIME[a];
}

const grouped = (number) => String(number).replace(/\B(?=(\d{3})+$)/g, ",");

function showSpan() {
  const rows = spanRows(), box = document.getElementById("span");
  box.hidden = !rows && !now.span && now.mark < 0;
  const told = rows ? `${grouped(between(rows))} ms from step ${STEP[rows[0]] + 1} to ${STEP[rows[1]] + 1}`
    : now.mark >= 0 ? `Step ${STEP[now.mark] + 1} is marked; select another, or Shift-click it` : "";
  const only = now.span ? `Only steps ${STEP[now.span[0]] + 1} to ${STEP[now.span[1]] + 1}` : "";
  document.getElementById("span-words").textContent = [told, only].filter(Boolean).join(" · ");
  document.getElementById("measure").setAttribute("aria-pressed", now.mark >= 0);
  document.getElementById("span-zoom").disabled = !rows;
  document.getElementById("span-whole").disabled = !now.span;
}

/** A bracket beside the times, from the mark to the selected row. */
function drawSpan(layer, y, size) {
  if (now.mark < 0) return;
  const [a, b] = spanRows() ?? [now.mark, now.mark], x = layout.gutter - 8;
  const top = Math.max(HEAD, y(a)), bottom = Math.min(size.height, y(b));
  if (bottom < HEAD || top > size.height) return;
  layer.append(make("rect", { class: "span", x: 0, y: top - HEIGHT / 2, width: layout.gutter - 2, height: bottom - top + HEIGHT }));
  layer.append(make("path", { class: "span-edge", d: `M${x} ${top}h3V${bottom}h-3` }));
}

function setMark(row) {
  now.mark = row;
  showSpan();
  redraw();
}

const toggleMark = () => setMark(now.mark === now.row ? -1 : now.row);

/** Step on with the mark where it is, or where the steps begin. */
function extend(by) {
  if (now.mark < 0) now.mark = now.row;
  step(by);
}

let scaleBefore = now.scale;

/** Show the rows of the span alone; in real time it fills the window. */
function zoomToSpan() {
  const rows = spanRows();
  if (!rows) return;
  if (!now.span) scaleBefore = now.scale;
  now.span = [rows[0], atStep(rows[1]).at(-1)];
  const tall = view.clientHeight - HEAD - 2 * HEIGHT;
  now.scale = tall / Math.max(1, CLOCK[now.span[1]] - CLOCK[now.span[0]]);
  sift();
  view.scrollTop = 0;
  showSpan();
}

/** Show all rows again, as they were before, without the mark. */
function showWhole() {
  now.mark = -1;
  setFollow(false);
  if (now.span) leaveSpan();
  showSpan();
  redraw();
}

function leaveSpan() {
  now.span = null;
  now.scale = scaleBefore;
  sift();
  reveal(now.row);
}

/** Select a span with the pointer, from where it was pressed, and show it alone. */
function dragSpan(press) {
  const from = rowAt(press.offsetY), begun = press.clientY;
  let moved = false;
  follow(press, (move) => {
    if (!moved && Math.abs(move.clientY - begun) < 6) return;
    moved = true;
    now.mark = from;
    now.row = rowAt(Math.max(HEAD, Math.min(view.clientHeight, move.clientY - view.getBoundingClientRect().top)));
    showSpan();
    redraw();
  }, (end) => {
    if (moved && end.type === "pointerup") {
      select(now.row, true);
      return zoomToSpan();
    }
    if (press.shiftKey && now.mark < 0) now.mark = now.row;
    if (from !== undefined) select(from, true);
    const arrow = press.target.closest(".arrow:not(.due)");
    if (arrow) {
      select(Number(arrow.dataset.row), true);
      setFollow(true);
    }
    if (press.target.closest(".copies")) toggleCopies(Number(press.target.parentNode.dataset.row));
  });
}
