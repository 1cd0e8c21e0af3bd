/* The address of the page: the step, and everything that was chosen for its view. */

/* What the filters are at first. */
const usual = {};
const chosenIn = (box) => (box.type === "checkbox" ? (box.checked ? "1" : "0") : box.value);

function rememberUsual() {
  for (const id in filters) usual[id] = chosenIn(filters[id]);
}

/** The address leads to the selected step in the view as it is. */
function toHash() {
  if (now.row < 0 || !Object.keys(usual).length) return;
  const found = [["step", STEP[now.row] + 1]];
  for (const id in filters) {
    if (chosenIn(filters[id]) !== usual[id]) found.push([id, chosenIn(filters[id])]);
  }
  const theme = document.documentElement.dataset.theme;
  const steps = (rows) => rows.map((row) => STEP[row] + 1).join("-");
  found.push(["unfolded", steps([...now.unfolded])], ["only", now.span ? steps(now.span) : ""],
    ["real", now.time ? Number(now.scale.toPrecision(4)) : ""], ["follow", now.follow ? 1 : ""],
    ["view", document.getElementById("tables").hidden ? "" : "table"], ["theme", theme ?? ""],
    ["time", now.logged ? "logged" : ""]);
  const parts = found.filter(([, value]) => value !== "" || false).map(([name, value]) =>
    `${name}=${encodeURIComponent(value)}`);
  history.replaceState(null, "", `#${parts.join("&")}`);
}

/** Take the view and the step of the address; false if it names no step. */
function fromHash() {
  const said = new URLSearchParams(location.hash.slice(1)), step = Number(said.get("step"));
  if (!Number.isInteger(step) || step < 1) return false;
  for (const id in filters) {
    const value = said.get(id) ?? usual[id];
    if (filters[id].type === "checkbox") filters[id].checked = value === "1";
    else filters[id].value = value;
  }
  const rows = (name) => (said.get(name) ?? "").split("-").filter(Boolean).map((one) => rowOfStep(Number(one) - 1));
  now.unfolded = new Set(rows("unfolded"));
  const only = rows("only");
  now.span = only.length === 2 ? [only[0], atStep(Math.min(only[1], COUNT - 1)).at(-1)] : null;
  now.follow = said.get("follow") === "1";
  const scale = Number(said.get("real"));
  if (scale > 0) now.scale = scale;
  if ((said.get("time") === "logged") !== now.logged) toggleLogged();
  if (scale > 0 !== now.time) toggleTime();
  if (said.get("theme")) document.documentElement.dataset.theme = said.get("theme");
  if ((said.get("view") === "table") === document.getElementById("tables").hidden) toggleTable();
  document.getElementById("follow").setAttribute("aria-pressed", now.follow);
  nameTheme();
  sift();
  select(rowOfStep(step - 1));
  return true;
}

const contents = new Map();

/** What identifies a message: its content, which all its copies share; empty without a message. */
function contentOf(row) {
  const place = ROW.body[row];
  if (!contents.has(place)) contents.set(place, JSON.stringify(body(row).message ?? ""));
  return "sr".includes(DATA.rows.kinds[row]) ? contents.get(place) : "";
}

/** Whether a row is not of the message that is followed. */
const isDimmed = (row) => now.follow && now.row >= 0 && contentOf(now.row).length > 2
  && contentOf(row) !== contentOf(now.row);

function setFollow(follow) {
  now.follow = follow;
  document.getElementById("follow").setAttribute("aria-pressed", follow);
  toHash();
  redraw();
}
