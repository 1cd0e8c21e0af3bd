/* The rows as a table, some at a time. */

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
    el("td", {}, ROW.line[row]), el("td", {}, timeText(row)),
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
  toHash();
}

function turnTable(by) {
  tableFirst += by;
  fillTable();
}
