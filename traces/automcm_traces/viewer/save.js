/* Downloads: the drawing in the window, the log up to the step, the messages as a diagram. */

const MOST_MESSAGES = 400;

function save(name, type, content) {
  const address = URL.createObjectURL(new Blob([content], { type }));
  const anchor = el("a", { href: address, download: name });
  document.body.append(anchor);
  anchor.click();
  anchor.remove();
  setTimeout(() => URL.revokeObjectURL(address), 10_000);
}

/** Put a text on the clipboard, and say so on the button. */
async function copyText(words, button) {
  try {
    await navigator.clipboard.writeText(words);
  } catch {
    const box = el("textarea", {}, "");
    box.value = words;
    document.body.append(box);
    box.select();
    document.execCommand("copy");
    box.remove();
  }
  button.textContent = "Copied";
}

const nameOf = (log) => `${named(LOGS[log].run, LOGS[log].station).replace(" · ", "-")}-${COUNT ? STEP[now.row] + 1 : 0}`;
/** The log to which the selected step belongs; of two runs that of the wanted one. */
function chosenLog(run) {
  const own = COUNT ? ROW.log[now.row] : 0;
  return LOGS[own].run === run ? own : MATE[own];
}

/** The drawing as it is in the window, with the style that it needs. */
function svgText() {
  const copy = svg.cloneNode(true), style = getComputedStyle(document.documentElement);
  const css = [...document.styleSheets[0].cssRules].map((rule) => rule.cssText).join("\n");
  const values = css.replace(/var\((--[a-z-]+)\)/g, (_, name) => style.getPropertyValue(name).trim());
  const ground = make("rect", { width: "100%", height: "100%", fill: colour("--ground") });
  copy.setAttribute("xmlns", SVG);
  copy.removeAttribute("aria-hidden");
  copy.setAttribute("height", svg.clientHeight + addLegend(copy));
  copy.prepend(make("style", {}), ground);
  const written = new XMLSerializer().serializeToString(copy);
  const safe = values.replace(/&/g, "&amp;").replace(/</g, "&lt;");
  return written.replace(/<style[^>]*\/>|<style[^>]*><\/style>/, () => `<style>${safe}</style>`);
}

/** Add the legend below a copy of the drawing; how much room it takes. */
function addLegend(copy) {
  let x = 10, y = svg.clientHeight + 6;
  for (const item of document.querySelectorAll("#legend li")) {
    const wide = 60 + textWidth(item.textContent), sample = item.querySelector("svg").cloneNode(true);
    if (x > 10 && x + wide > svg.clientWidth) [x, y] = [10, y + 22];
    sample.setAttribute("x", x);
    sample.setAttribute("y", y);
    copy.append(sample, make("text", { class: "legend", x: x + 50, y: y + 12, fill: colour("--text") },
      item.lastChild.textContent));
    x += wide + 12;
  }
  return y + 24 - svg.clientHeight;
}

/** The drawing as a picture of twice as many pixels. */
function savePng(name) {
  const picture = new Image();
  picture.onload = () => {
    const sheet = document.createElement("canvas");
    [sheet.width, sheet.height] = [2 * picture.width, 2 * picture.height];
    sheet.getContext("2d").drawImage(picture, 0, 0, sheet.width, sheet.height);
    sheet.toBlob((blob) => save(name, "image/png", blob));
  };
  picture.src = `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svgText())}`;
}

/** A log up to and with a row, as a log of its own. */
function prefixText(log, row) {
  const kept = rowsOf[log].filter((one) => one <= row), { header, before } = LOGS[log];
  const lines = [before ? { ...header, begins: "running" } : header];
  kept.forEach((one, n) => lines.push({ ...logged(one), seq: before + n + 1 }));
  lines.push({ rec: "end", seq: before + kept.length, reason: "prefix", lost_records: 0 });
  return lines.map((line) => `${JSON.stringify(line)}\n`).join("");
}

/** The messages that are shown, from the window on, as a sequence diagram of Mermaid. */
function mermaidText() {
  const plain = (words) => words.replace(/[^\w .,/#()>-]/g, "?").replace(/ *#/g, " no. ");
  const lines = ["sequenceDiagram"];
  const used = new Set(), said = [];
  const [a] = inWindow();
  for (const row of now.shown.slice(a).flatMap(abreast)) {
    for (const arrow of arrowsFrom(row)) {
      if (said.length >= MOST_MESSAGES) break;
      used.add(arrow.from).add(arrow.to);
      const head = { [DELIVERED]: "->>", [LOST]: "-x", [IN_FLIGHT]: "-)" }[arrow.kind] ?? "-->>";
      const fate = arrow.kind === DELIVERED ? "" : ` (${became(arrow)})`;
      said.push(`  c${arrow.from}${head}c${arrow.to}: ${plain(text(row).slice(0, 60))}${fate}`);
    }
  }
  for (const column of [...used].sort((x, y) => layout.x[x] - layout.x[y])) {
    lines.push(`  participant c${column} as ${plain(COLUMNS[column].name.replace(" · ", " "))}`);
  }
  if (said.length >= MOST_MESSAGES) said.push(`  %% only the first ${MOST_MESSAGES} messages`);
  return [...lines, ...said].join("\n") + "\n";
}

document.getElementById("save-svg").addEventListener("click", () =>
  save(`${nameOf(COUNT ? ROW.log[now.row] : 0)}.svg`, "image/svg+xml", svgText()));
document.getElementById("save-png").addEventListener("click", () =>
  savePng(`${nameOf(COUNT ? ROW.log[now.row] : 0)}.png`));
RUNS.forEach((_, run) => document.getElementById(`save-log${run || ""}`).addEventListener("click", () => {
  const log = chosenLog(run), last = COUNT ? atStep(now.row).at(-1) : -1;
  if (log >= 0 && COUNT) save(`${nameOf(log)}.ndjson`, "application/x-ndjson", prefixText(log, last));
}));
document.getElementById("save-mermaid").addEventListener("click", () =>
  save(`${nameOf(COUNT ? ROW.log[now.row] : 0)}.mmd`, "text/plain", mermaidText()));
