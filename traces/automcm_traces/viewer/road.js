/* Where the vehicles are, as their CAMs say, at the selected step. */

const ROAD = { width: 600, height: 110, margin: 24 };

/* By station: the rows with its CAMs. */
const camRows = (function () {
  const found = new Map();
  for (let row = 0; row < COUNT; row++) {
    if (!(ROW.flags[row] & IS_CAM)) continue;
    const { src, x_mm: x, y_mm: y } = body(row).message;
    if (!Number.isInteger(src) || !Number.isFinite(x) || !Number.isFinite(y)) continue;
    if (!found.has(src)) found.set(src, []);
    found.get(src).push(row);
  }
  return found;
})();

const cam = (row) => body(row).message;

/** What all positions span, in mm, with some room; worked out once. */
const span = (function () {
  const box = { left: Infinity, right: -Infinity, low: Infinity, high: -Infinity };
  for (const rows of camRows.values()) {
    for (const row of rows) {
      const { x_mm: x, y_mm: y } = cam(row);
      box.left = Math.min(box.left, x);
      box.right = Math.max(box.right, x);
      box.low = Math.min(box.low, y);
      box.high = Math.max(box.high, y);
    }
  }
  return { ...box, wide: Math.max(1000, box.right - box.left), tall: Math.max(1000, box.high - box.low) };
})();

/** The last CAM of a station at or before a row; -1 if there is none. */
function lastCam(src, row) {
  const rows = camRows.get(src);
  const n = search(rows.length, (i) => rows[i] > row);
  return n ? rows[n - 1] : -1;
}

/** A strip with each vehicle as a wedge that points where it drives; null without CAMs. */
function road(row) {
  if (!camRows.size) return null;
  const { width, height, margin } = ROAD;
  const x = (mm) => margin + ((mm - span.left) / span.wide) * (width - 2 * margin);
  const y = (mm) => height - margin - ((mm - span.low) / span.tall) * (height - 2 * margin - 16);
  const strip = make("svg", { class: "road", viewBox: `0 0 ${width} ${height}`, role: "img" });
  const told = [];
  strip.append(make("rect", { class: "ground", x: 0, y: 0, width, height, rx: 4 }));
  [...camRows.keys()].sort((a, b) => a - b).slice(0, 40).forEach((src, n) => {
    const last = lastCam(src, row);
    if (last < 0) return;
    const { x_mm, y_mm, heading_mrad: heading, speed_mm_s: speed } = cam(last);
    const turn = Number.isFinite(heading) ? (-heading * 180) / (1000 * Math.PI) : 0;
    const at = `translate(${x(x_mm)} ${y(y_mm)})`;
    strip.append(make("path", { class: "vehicle", d: "M9 0L-7 -5L-3 0L-7 5Z", transform: `${at} rotate(${turn})` }));
    strip.append(make("text", { x: x(x_mm), y: y(y_mm) - 9 - (n % 2) * 11, "text-anchor": "middle" }, String(src)));
    told.push(`${src} at ${(x_mm / 1000).toFixed(1)}, ${(y_mm / 1000).toFixed(1)} m`
      + (Number.isFinite(speed) ? `, ${(speed / 1000).toFixed(1)} m/s` : ""));
  });
  strip.append(make("text", { class: "unit", x: 6, y: height - 5 }, `${(span.left / 1000).toFixed(0)} m`));
  strip.append(make("text", { class: "unit", x: width - 6, y: height - 5, "text-anchor": "end" },
    `${(span.right / 1000).toFixed(0)} m`));
  strip.setAttribute("aria-label", told.join("; "));
  return { strip, told };
}
