/* In which phase each station is: of its state where the log was followed, else as it was logged. */

/* Those that have a colour; STANDALONE has none. */
const PHASE_NAMES = ["advertising", "choosing", "prescribing", "intending", "waiting", "negotiating", "actuating"];

/* By log, in order: the first and last row of each phase. */
const PHASES = LOGS.map((_, log) => {
  const rows = rowsOf[log], found = [];
  const enter = (row, phase) => {
    if (found.at(-1)?.phase === phase) return;
    if (found.length) found.at(-1).last = row;
    found.push({ first: row, last: rows.at(-1), phase });
  };
  if (STEPS[log].length) {
    for (const [step, { phase }] of CHANGES[log]) {
      if (phase === undefined || phase === found.at(-1)?.phase) continue;
      enter(rows[search(rows.length, (n) => ROW.line[rows[n]] >= STEPS[log][step])], phase);
    }
    if (LOGS[log].diverges >= 0) enter(LOGS[log].diverges, "");
  } else {
    for (const row of rows) if (hint(row)[1]) enter(row, hint(row)[1]);
  }
  return found;
});

/** The phase of a station at a row; empty if it is not known. */
function phaseAt(log, row) {
  const n = search(PHASES[log].length, (i) => PHASES[log][i].first > row);
  return n ? PHASES[log][n - 1].phase : "";
}

/** The phase in which an event leaves its station, if that is another than before. */
function phaseChange(row) {
  const phase = hint(row)[1];
  return phase && phase !== (phasesBefore[row] || "STANDALONE") ? phase : "";
}

const phasesBefore = (function () {
  const last = LOGS.map(() => ""), found = new Array(COUNT);
  for (let row = 0; row < COUNT; row++) {
    found[row] = last[ROW.log[row]];
    last[ROW.log[row]] = hint(row)[1] || last[ROW.log[row]];
  }
  return found;
})();

/** The phases of the columns as bands, each from its first row to the next phase. */
function drawPhases(layer, first, last, y, seen, height) {
  for (const log of LOGS.keys()) {
    if (!seen[log]) continue;
    const phases = PHASES[log];
    for (let n = search(phases.length, (i) => phases[i].last >= first); phases[n]?.first <= last; n++) {
      const { phase, first: from, last: to } = phases[n];
      if (!phase || phase === "STANDALONE") continue;
      const half = now.time ? 0 : HEIGHT / 2, end = n + 1 < phases.length ? -half : half;
      const top = Math.max(HEAD - 4, y(from) - half), bottom = Math.min(height + 4, y(to) + end);
      if (bottom <= top) continue;
      const x = layout.x[log] + 2, width = layout.width[log] - 4, name = `phase ${phase.toLowerCase().replace(/[^a-z]/g, "")}`;
      layer.append(make("g", { class: name }, make("title", {}, `${COLUMNS[log].name}: ${visible(phase)}`),
        make("rect", { class: "tint", x, y: top, width, height: bottom - top }),
        make("rect", { class: "edge", x, y: top, width: 3, height: bottom - top })));
    }
  }
}
