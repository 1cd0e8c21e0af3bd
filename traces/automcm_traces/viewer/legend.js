/* What can be chosen in the filters, and what the lines and colours mean. */

function choices(select_, all, values) {
  select_.append(el("option", { value: "" }, all));
  for (const value of values.slice(0, 500)) select_.append(el("option", { value }, value));
}

function legend() {
  const shown = [[0, "delivered"], [1, "lost"], [2, "duplicate"], [3, "unobserved"], [4, "in flight"],
    [7, "overheard"]];
  document.getElementById("legend").append(...shown.map(([arrow, words]) => {
    const sample = make("svg", { width: 46, height: 16, "aria-hidden": "true" });
    const group = make("g", { class: `arrow ${ARROWS[arrow].replace(" ", "-")}` });
    if (arrow === IN_FLIGHT) fading(group, 3, 8, 36, 8);
    else line(group, 3, 8, arrow === LOST ? 28 : arrow === UNOBSERVED ? 32 : 42, 8, [DELIVERED, DUPLICATE, OVERHEARD].includes(arrow));
    if (arrow === LOST) cross(group, 32, 8);
    if (arrow === UNOBSERVED) sign(group, 39, 8, "?");
    sample.append(group);
    return el("li", {}, sample, words);
  }), ...CAUSES.map(rejectedSample), timerSample());
}

function rejectedSample(name) {
  const sample = make("svg", { width: 46, height: 16, "aria-hidden": "true" });
  const group = make("g", { class: `arrow rejected ${name}` });
  stopped(group, 3, 10, 42, 10);
  sign(group, 34, 2, initial(name));
  sample.append(group);
  const reasons = Object.keys(DATA.rejected).filter((reason) => DATA.rejected[reason] === name);
  return el("li", { title: reasons.join(", ") }, sample, `rejected: ${name}`);
}

function timerSample() {
  const sample = make("svg", { width: 46, height: 16, "aria-hidden": "true" });
  sample.append(make("g", { class: "bar expired" }, make("rect", { x: 4, y: 6, width: 32, height: 4, rx: 2 }),
    make("circle", { class: "fired", cx: 36, cy: 8, r: 4 }), make("path", { class: "deadline", d: "M30 1v14" })));
  return el("li", {}, sample, "timer: ● fired, ┃ due");
}

function types() {
  const found = new Set(DATA.rows.bodies.length < 200_000 ? typeNames() : []);
  return [...found].sort();
}

/** Every type of message there is, without unpacking what is not a message. */
function typeNames() {
  const holder = DATA.shapes.map((keys) => keys.indexOf("message") + 1);
  const names = DATA.shapes.map((keys) => keys.indexOf("type") + 1);
  const found = new Set();
  for (const packed of DATA.rows.bodies) {
    const m = holder[packed[0]] ? packed[holder[packed[0]]] : null;
    if (Array.isArray(m) && names[m[0]]) found.add(m[names[m[0]]]);
  }
  return found;
}

/** Each mark and each phase with its name. */
function samples() {
  const sample = (...drawn) => make("svg", { width: 18, height: 14, "aria-hidden": "true" }, ...drawn);
  const marks = Object.entries(MARKS).map(([name, d]) => el("li", {}, sample(make("g", { class: `row ${name}` },
    make("path", { class: "mark", d, transform: "translate(8 7)" }))), name));
  const phases = PHASE_NAMES.map((name) => el("li", {}, sample(make("g", { class: `phase ${name}` },
    make("rect", { class: "tint", x: 0, y: 0, width: 16, height: 14 }),
    make("rect", { class: "edge", x: 0, y: 0, width: 3, height: 14 }))), name.toUpperCase()));
  return [...marks, ...phases];
}
