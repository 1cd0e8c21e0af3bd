/* Runs the script of a page with a document in which everything exists and nothing happens. */
const [data, script] = require("fs").readFileSync(0, "utf8").split("\n---\n");
const any = () => new Proxy(function () {}, {
  get: (held, key) => {
    if (key === Symbol.toPrimitive) return () => 0;
    if (key === Symbol.iterator) return function* () {};
    if (key === "value" || key === "textContent") return held[key] ?? "";
    return Object.hasOwn(held, key) && key !== "name" && key !== "length" && key !== "prototype"
      ? held[key] : key === "then" ? undefined : (held[key] = any());
  },
  set: (held, key, value) => { held[key] = value; return true; },
  apply: any,
  construct: any,
});
const document = any();
document.getElementById = (id) => (id === "data" ? { textContent: data } : any());
const nothing = Object.fromEntries(["window", "history", "getComputedStyle", "localStorage", "CSS"].map((n) => [n, any()]));
require("vm").runInNewContext(script, { ...nothing, document, URLSearchParams, location: { hash: "" }, Node: class {},
  matchMedia: () => ({}), ResizeObserver: class { observe() {} }, requestAnimationFrame: () => 0 });
