/* The minimap: all rows that are shown, and the window among them. */

const map = document.getElementById("map"), small = document.createElement("canvas");

const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function drawMap() {
  map.height = small.height = Math.max(40, map.parentElement.clientHeight);
  small.width = map.width;
  const pen = small.getContext("2d"), drawn = new Set(), lost = new Set();
  const colours = { send: colour("--send"), receive: colour("--receive"), other: colour("--dim") };
  const wide = (map.width - 8) / LOGS.length;
  for (const row of TWO ? now.shown.flatMap(abreast) : now.shown) {
    const y = Math.floor(mapY(row)), column = ROW.log[row], name = kind(row);
    if (lossesOf(row)) lost.add(y);
    const key = y * 100_000 + column * 3 + (name === "send" ? 0 : name === "receive" ? 1 : 2);
    if (drawn.has(key)) continue;
    drawn.add(key);
    pen.fillStyle = colours[name] ?? colours.other;
    pen.fillRect(4 + column * wide, y, Math.max(1, wide - 1), 1.5);
  }
  pen.fillStyle = colour("--wrong");
  for (const y of lost) pen.fillRect(map.width - 8, y, 8, 2);
  const mark = (row, name) => {
    pen.fillStyle = colour(name);
    pen.fillRect(0, Math.floor(mapY(row)) - 1, map.width, 3);
  };
  if (DIFFERENCE < Infinity) mark(DIFFERENCE, "--told");
  for (const log of LOGS) if (log.diverges >= 0) mark(log.diverges, "--wrong");
}

/** Down to a row in the minimap. */
function mapY(row) {
  const all = heightOfAll();
  return all ? (down(row) / all) * (map.height - 4) : 0;
}

function showWindow() {
  const pen = map.getContext("2d");
  const all = Math.max(1, heightOfAll());
  const scale = (map.height - 4) / all;
  pen.clearRect(0, 0, map.width, map.height);
  pen.drawImage(small, 0, 0);
  pen.strokeStyle = colour("--text");
  pen.lineWidth = 1.5;
  const tall = Math.min(map.height - 3, Math.max(6, view.clientHeight * scale));
  pen.strokeRect(1, Math.min(view.scrollTop * scale + 1, map.height - tall - 2), map.width - 2, tall);
  pen.fillStyle = colour("--accent");
  if (COUNT) pen.fillRect(0, mapY(now.row), map.width, 2);
}
