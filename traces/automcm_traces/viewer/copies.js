/* Copies of a message, as copy_folding.py folds them, for `show` too. */

/* By row the row into which it is folded; -1 if it is not a copy. */
const FOLDED = column("copy").map((back, row) => (back ? row - back : -1));
/* By row how many copies are folded into it. */
const copies = new Map();
for (const head of FOLDED) if (head >= 0) copies.set(head, (copies.get(head) ?? 0) + 1);

/* By row the kinds of its arrows as bits, and how many of its messages were lost; for the row of
   folded copies also those of all together. */
const fates = new Int32Array(COUNT), losses = new Int32Array(COUNT);
for (const { first, last, kind } of arrows) {
  for (const row of new Set([first, last])) fates[row] |= 1 << kind;
  if (kind === LOST) losses[first]++;
}
const fatesOfAll = fates.slice(), lossesOfAll = losses.slice();
for (let row = 0; row < COUNT; row++) {
  if (FOLDED[row] < 0) continue;
  fatesOfAll[FOLDED[row]] |= fates[row];
  lossesOfAll[FOLDED[row]] += losses[row];
}

/** Whether the copies of a row are folded into it. */
const holdsCopies = (row) => copies.has(row) && !filters.copies.checked && !now.unfolded.has(row);
const lossesOf = (row) => (holdsCopies(row) ? lossesOfAll : losses)[row];
const fatesOf = (row) => (holdsCopies(row) ? fatesOfAll : fates)[row];

/** Whether a row is a copy that is not shown by itself. */
const isFolded = (row) => FOLDED[row] >= 0 && !filters.copies.checked && !now.unfolded.has(FOLDED[row]);

/** The row that stands for a row. */
const headOf = (row) => (isFolded(row) ? FOLDED[row] : row);

/** How often a message is there, at the row into which its copies are folded. */
function times(row) {
  const more = copies.get(row);
  if (!more) return "";
  return `${holdsCopies(row) ? "▸" : "▾"} ×${more + 1}`;
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
