/* Where the vehicles are, as their CAMs say, at the selected step. */

const ROAD = { width: 600, height: 150, margin: 24 };

/* By run and station: the rows with its CAMs. */
const camRows = (function () {
  const runs = RUNS.map(() => new Map());
  for (let row = 0; row < COUNT; row++) {
    if (!(ROW.flags[row] & IS_CAM)) continue;
    const { src, x_mm: x, y_mm: y } = body(row).message;
    if (!Number.isInteger(src) || !Number.isFinite(x) || !Number.isFinite(y)) continue;
    const found = runs[runOf(row)];
    if (!found.has(src)) found.set(src, []);
    found.get(src).push(row);
  }
  return runs;
})();

const cam = (row) => body(row).message;

/** The last of rows at or before a row; -1 if there is none. */
function lastCam(rows, row) {
  const n = search(rows.length, (i) => rows[i] > row);
  return n ? rows[n - 1] : -1;
}

/** The part of the road around vehicles, in mm: at least 60 m along and 8 m across. */
function around(vehicles) {
  const along = vehicles.map((v) => v.x_mm), across = vehicles.map((v) => v.y_mm);
  const part = (values, least) => {
    const low = Math.min(...values), high = Math.max(...values), middle = (low + high) / 2;
    const half = Math.max(least, (high - low) * 1.2) / 2;
    return { low: middle - half, size: 2 * half };
  };
  return { along: part(along, 60_000), across: part(across, 8_000) };
}

/** Lines across the road at round distances, named. */
function ticks(strip, part, x, height) {
  const apart = 10 ** Math.ceil(Math.log10(part.size / 12));
  for (let mm = Math.ceil(part.low / apart) * apart; mm < part.low + part.size; mm += apart) {
    strip.append(make("line", { class: "tick", x1: x(mm), x2: x(mm), y1: 0, y2: height - 18 }));
    strip.append(make("text", { class: "unit", x: x(mm), y: height - 5, "text-anchor": "middle" },
      `${mm / 1000} m`));
  }
}

/** All road users at a time, if the page has their positions: those in the frame before it. */
function usersAt(ms) {
  const { first_ms: first, every_ms: every, frames, users } = DATA.traffic;
  const frame = frames[Math.max(0, Math.min(frames.length - 1, Math.floor((ms - first) / every)))];
  if (!frame) return [];
  const about = new Map(users.map((user) => [user.number, user]));
  return frame.number.map((number, n) => ({ ...about.get(number), src: number, x_mm: frame.x_mm[n],
    y_mm: frame.y_mm[n], heading_mrad: frame.heading_mrad[n] })).filter((user) => user.length_mm);
}

const SEEN = 120_000; // mm before and behind the station of the row

const above = document.getElementById("above");

/** The traffic from above across the page, at the time of a row or later. */
function showTraffic(row, ms = TIME[row]) {
  above.hidden = !DATA.traffic;
  const found = DATA.traffic && COUNT ? traffic(row, ms, above.clientWidth || 600) : null;
  above.replaceChildren(...(found ? [found.strip] : ["The station of this row is not on the road."]));
}

/** The traffic from above, around the station of a row: each road user as a rectangle of its size,
    those with a log with their names; null where it is not on the road. A lane is at least 14
    wide, unless the roads lie across. */
function traffic(row, ms, width) {
  const logged = new Set(LOGS.map(({ station }) => station)), all = usersAt(ms);
  const own = all.find(({ src }) => src === LOGS[ROW.log[row]].station);
  if (!own) return null;
  const everybody = all.filter(({ x_mm: x }) => Math.abs(x - own.x_mm) < SEEN), told = [];
  const { margin } = ROAD, part = around(everybody);
  part.along = { low: own.x_mm - SEEN, size: 2 * SEEN };
  const scale = (width - 2 * margin) / part.along.size;
  const wide = part.across.size > 30_000 ? 1 : Math.max(1, 14 / (scale * 3500));
  const height = Math.min(280, Math.max(96, part.across.size * scale * wide + 60));
  const x = (mm) => margin + (mm - part.along.low) * scale;
  const y = (mm) => height - 34 - (mm - part.across.low) * scale * wide;
  const strip = make("svg", { class: "road", viewBox: `0 0 ${width} ${height}`, role: "img" });
  strip.append(make("rect", { class: "ground", x: 0, y: 0, width, height, rx: 4 }));
  ticks(strip, part.along, x, height);
  const names = [];
  for (const user of everybody) {
    const at = [x(user.x_mm), y(user.y_mm)];
    if (at[0] < 0 || at[0] > width || at[1] < 0 || at[1] > height - 20) continue;
    const long = user.length_mm * scale, broad = user.width_mm * scale * wide;
    const kind = logged.has(user.src) ? "vehicle" : user.equipped ? "vehicle station" : "vehicle other";
    strip.append(make("rect", { class: kind, x: -long / 2, y: -broad / 2, width: long, height: broad,
      rx: 1, transform: `translate(${at[0]} ${at[1]}) rotate(${(-user.heading_mrad * 180) / (1000 * Math.PI)})` }));
    if (!logged.has(user.src)) continue;
    strip.append(labelOf(String(user.src), at[0], at[1], names).label);
    told.push(`${user.src} at ${(user.x_mm / 1000).toFixed(1)}, ${(user.y_mm / 1000).toFixed(1)} m`);
  }
  strip.setAttribute("aria-label", told.join("; "));
  return { strip, told };
}

/** A strip with each vehicle as a wedge that points where it drives; null without CAMs. */
function road(run, row) {
  if (DATA.traffic) return null;
  const known = [...camRows[run]].sort(([a], [b]) => a - b).slice(0, 40)
    .map(([, rows]) => lastCam(rows, row)).filter((last) => last >= 0).map(cam);
  if (!known.length) return null;
  const { width, height, margin } = ROAD, part = around(known), told = [];
  const x = (mm) => margin + ((mm - part.along.low) / part.along.size) * (width - 2 * margin);
  const y = (mm) => height - 34 - ((mm - part.across.low) / part.across.size) * (height - 100);
  const strip = make("svg", { class: "road", viewBox: `0 0 ${width} ${height}`, role: "img" });
  strip.append(make("rect", { class: "ground", x: 0, y: 0, width, height, rx: 4 }));
  ticks(strip, part.along, x, height);
  const names = [];
  known.forEach((v) => {
    strip.append(vehicle(v, x(v.x_mm), y(v.y_mm), names));
    told.push(`${v.src} at ${(v.x_mm / 1000).toFixed(1)}, ${(v.y_mm / 1000).toFixed(1)} m`
      + (Number.isFinite(v.speed_mm_s) ? `, ${(v.speed_mm_s / 1000).toFixed(1)} m/s` : ""));
  });
  strip.setAttribute("aria-label", told.join("; "));
  return { strip, told };
}

/** A name above a place and above the names of its neighbours; empty where there is no room. */
function labelOf(name, x, y, names) {
  const half = textWidth(name) * 0.6 + 2, label = make("g", {});
  let up = y - 12;
  const isTaken = (one) => Math.abs(one.x - x) < one.half + half && Math.abs(one.up - up) < 17;
  while (names.some(isTaken)) up -= 1;
  if (up < 13) return { label, up };
  names.push({ x, up, half });
  label.append(make("text", { x, y: up, "text-anchor": "middle" }, name));
  return { label, up };
}

/** A wedge and its name; without a name where there is no room. */
function vehicle(v, x, y, names) {
  const turn = Number.isFinite(v.heading_mrad) ? (-v.heading_mrad * 180) / (1000 * Math.PI) : 0;
  const group = make("g", {}, make("path", { class: "vehicle", d: "M12 0L-9 -6L-4 0L-9 6Z",
    transform: `translate(${x} ${y}) rotate(${turn})` }));
  const { label, up } = labelOf(String(v.src), x, y, names);
  if (up < 13) return group;
  group.prepend(make("line", { class: "tick", x1: x, x2: x, y1: y, y2: up + 2 }));
  group.append(label);
  return group;
}
