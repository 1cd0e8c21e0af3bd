/* Copies of a message, as copy_folding.py folds them, for `show` too. */

/* By row the row into which it is folded; -1 if it is not a copy. */
const FOLDED = column("copy").map((back, row) => (back ? row - back : -1));
/* By row how many copies are folded into it. */
const copies = new Map();
for (const head of FOLDED) if (head >= 0) copies.set(head, (copies.get(head) ?? 0) + 1);

/** Whether a row is a copy that is not shown by itself. */
const isFolded = (row) => FOLDED[row] >= 0 && !filters.copies.checked && !now.unfolded.has(FOLDED[row]);

/** The row that stands for a row. */
const headOf = (row) => (isFolded(row) ? FOLDED[row] : row);

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
