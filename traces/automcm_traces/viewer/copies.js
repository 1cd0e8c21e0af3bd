/* Copies of a message: what a station sends, or receives, once more. They are folded into the row of
   the message, with the timers of their steps. CAMs, and the timers that they arm, are no copies. */

/* By row the row into which it is folded; -1 if it is not a copy. */
const FOLDED = new Int32Array(COUNT).fill(-1);
/* By row how many copies are folded into it. */
const copies = new Map();

(function findCopies() {
  const steps = [], stepOf = new Int32Array(COUNT), folds = [];
  for (const log of LOGS.keys()) {
    const seen = new Set();
    let begins = true;
    for (const row of rowsOf[log]) {
      const isCam = (ROW.flags[row] & OF_CAM) !== 0;
      if (!isCam && (begins || isInput(row))) folds[steps.push([]) - 1] = true;
      begins = isCam;
      if (isCam) continue;
      const step = (stepOf[row] = steps.length - 1);
      steps[step].push(row);
      const isCopy = isMessage(row) && seen.has(ROW.text[row]);
      if (isMessage(row)) seen.add(ROW.text[row]);
      if (diverges(row) || !(isCopy || DATA.rows.kinds[row] === "t")) folds[step] = false;
    }
  }
  steps.forEach((rows, step) => (folds[step] &&= rows.some(isMessage)));
  /* What is received at a row that is not folded was sent at one that is not. */
  const sentAt = new Map();
  for (const { first, last } of arrows) if (last > first && isMessage(last)) sentAt.set(last, first);
  const open = [...steps.keys()].filter((step) => !folds[step]);
  while (open.length) {
    for (const row of steps[open.pop()]) {
      const sender = sentAt.has(row) ? stepOf[sentAt.get(row)] : -1;
      if (folds[sender]) {
        folds[sender] = false;
        open.push(sender);
      }
    }
  }
  const heads = new Map(), headOf = (row) => `${ROW.log[row]} ${ROW.text[row]}`;
  steps.forEach((rows, step) => {
    const messages = rows.filter(isMessage);
    if (!folds[step]) return messages.forEach((row) => heads.set(headOf(row), row));
    for (const row of rows) FOLDED[row] = heads.get(headOf(isMessage(row) ? row : messages[0]));
    for (const row of messages) copies.set(FOLDED[row], (copies.get(FOLDED[row]) ?? 0) + 1);
  });
})();

function isMessage(row) {
  return "sr".includes(DATA.rows.kinds[row]) && !(ROW.flags[row] & IS_CAM);
}

/** Whether a row is what a step of its station begins with. */
function isInput(row) {
  const name = DATA.rows.kinds[row];
  return name === "r" || name === "c" || name === "x" || (name === "t" && text(row).startsWith("expire "));
}

/** Whether a row is a copy that is not shown by itself. */
const isFolded = (row) => FOLDED[row] >= 0 && !filters.copies.checked && !now.unfolded.has(FOLDED[row]);

/** How often a message is there, at the row into which its copies are folded. */
function times(row) {
  const more = copies.get(row);
  if (!more) return "";
  return `${filters.copies.checked || now.unfolded.has(row) ? "▾" : "▸"} ×${more + 1}`;
}

/** Unfold the copies of a row, or fold them again. */
function toggleCopies(row) {
  const head = copies.has(row) ? row : FOLDED[row];
  if (head < 0 || filters.copies.checked) return;
  if (!now.unfolded.delete(head)) now.unfolded.add(head);
  const at = down(head);
  now.row = head;
  sift();
  view.scrollTop += down(head) - at;
  select(head, true);
}
