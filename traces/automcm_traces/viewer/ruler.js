/* Real time: how far down a time is, where long waits are cut, and a ruler beside the columns. */

const RULER = 58, LONG = 160, CUT = 40;
/* The waits that are cut, in order: their times, and the pixels saved up to their end. */
let cuts = [];

/** Find the waits between shown rows that would take too much room; a span alone is whole. */
function findCuts() {
  cuts = [];
  if (!now.time || now.span || !COUNT) return;
  let from = CLOCK[0], less = 0;
  for (const row of now.shown) {
    const to = CLOCK[row], tall = (to - from) * now.scale;
    if (tall > LONG) {
      less += tall - CUT;
      cuts.push({ from, to, less });
    }
    from = to;
  }
}

/** Down to a time from the top of the first row. */
function timeDown(ms) {
  const n = search(cuts.length, (i) => cuts[i].to > ms), cut = cuts[n];
  const y = (ms - CLOCK[firstRow()]) * now.scale - (n ? cuts[n - 1].less : 0);
  if (!cut || ms <= cut.from) return y;
  return y - (ms - cut.from) * (now.scale - CUT / (cut.to - cut.from));
}

/** The time at a height. */
const timeAt = (y) => CLOCK[0] + search(CLOCK[COUNT - 1] - CLOCK[0], (ms) => timeDown(CLOCK[0] + ms) >= y);

const seconds = (ms) => `${Number((ms / 1000).toFixed(3))} s`;

/** Ticks at round times, and a wave over each wait that is cut. */
function drawRuler(layer, at, size) {
  const x = layout.total - RULER, begin = CLOCK[0], apart = roundTime(50 / now.scale);
  const from = timeAt(at.top + HEAD), to = timeAt(at.top + size.height);
  const y = (ms) => timeDown(ms) + HEIGHT / 2 - at.top;
  let free = HEAD + 4;
  const label = (middle, words, name) => {
    if (middle < free) return;
    free = middle + 14;
    layer.append(make("text", { class: name, x: x + 8, y: middle + 4 }, words));
  };
  for (let ms = begin + Math.ceil((from - begin) / apart) * apart; ms <= to; ms += apart) {
    const inCut = cuts.some((cut) => ms > cut.from && ms < cut.to);
    if (inCut || y(ms) < HEAD) continue;
    layer.append(make("path", { class: "tick", d: `M${layout.x[now.order[0][0]] ?? 0} ${y(ms)}H${x + 5}` }));
    label(y(ms), seconds(ms - begin), "unit");
  }
  for (const cut of cuts.filter((one) => one.to >= from && one.from <= to)) {
    const middle = (y(cut.from) + y(cut.to)) / 2;
    if (middle < HEAD + 6) continue;
    const left = fixedWidth() + at.left, waves = Math.max(1, Math.floor((x - left) / 24));
    layer.append(make("path", { class: "cut", d: `M${left} ${middle}q6 -5 12 0t12 0${"t12 0t12 0".repeat(waves - 1)}` }));
    layer.append(make("text", { class: "cut-words", x: x + 4, y: middle + 4 }, `+${seconds(cut.to - cut.from)}`));
  }
}

/** The least of 1, 2, 5, 10, … ms that is not below a number. */
function roundTime(least) {
  const power = 10 ** Math.max(0, Math.floor(Math.log10(Math.max(1, least))));
  return [1, 2, 5, 10].map((n) => n * power).find((n) => n >= least);
}
