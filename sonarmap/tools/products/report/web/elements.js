// Colors that people with any kind of color vision can tell apart: matplotlib's maps.

const RAMPS = {
  viridis:
    "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725",
  cividis:
    "00224e 002e6a 1a386f 32436d 434e6c 535a6d 61656f 6f7073 7d7c78 8c8878 9b9476 aba072 bcae6c cdbb63 dec958 f0d846 fee838",
  magma:
    "000004 0a0822 1d1147 36106b 51127c 6a1c81 832681 9c2e7f b73779 d0416f e75263 f56b5c fc8961 fea772 fec488 fde2a3 fcfdbf",
  plasma:
    "0d0887 310597 4c02a1 6600a7 7e03a8 9511a1 aa2395 bc3587 cc4778 da5a6a e66c5c f0804e f89540 fdac33 fdc527 f8df25 f0f921",
};
const UNKNOWN = [128, 128, 128];
const TEXELS = 256; // of a palette; the last is for what is not known

const colorsOf = (hexes) => hexes.split(" ").map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));

/** A palette that changes evenly, by its name. */
function ramp(name) {
  const stops = colorsOf(RAMPS[name]);
  const colors = [];
  for (let k = 0; k < TEXELS - 1; k++) {
    const at = (k / (TEXELS - 2)) * (stops.length - 1);
    const before = Math.min(Math.floor(at), stops.length - 2);
    colors.push(stops[before].map((value, c) => Math.round(value + (at - before) * (stops[before + 1][c] - value))));
  }
  return [...colors, UNKNOWN];
}

// Elements of the page and numbers in words. Every text, whatever file it comes from, becomes a text node: never markup.

/** An element with attributes, listeners (`onclick: function`) and children: elements, or texts. */
function make(tag, attributes = {}, ...children) {
  const svg = ["svg", "g", "path", "line", "text", "rect", "circle"].includes(tag);
  const element = svg ? document.createElementNS("http://www.w3.org/2000/svg", tag) : document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name.slice(2), value);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null).map((child) => (child instanceof Node ? child : String(child))));
  return element;
}

/** A button; `more` are further attributes. */
const button = (text, onclick, more = {}) => make("button", { type: "button", onclick, ...more }, text);

/** A button that looks like a link. */
const link = (text, onclick) => button(text, onclick, { class: "link" });

/** A list to choose from, of [value, text]. */
const choice = (options, attributes, chosen) => make("select", attributes,
  ...options.map(([value, text]) => make("option", { value, selected: String(value) === String(chosen) }, text)));

/** A length with as many decimals as `step` [m] has use for. */
function meters(value, step = 0.01) {
  const decimals = Math.max(0, Math.min(4, Math.ceil(-Math.log10(step))));
  return `${value.toFixed(decimals)}\u202fm`;
}

/** A number with three valid digits, and its unit. */
function short(value, unit = "") {
  if (value === null || value === undefined) return "";
  const digits = Math.abs(value) >= 1000 ? Math.round(value).toLocaleString("en") : String(Number(value.toPrecision(3)));
  return unit ? `${digits}\u202f${unit}` : digits;
}

/** A number of things, such as "1 loop". */
const counted = (count, what) => `${count.toLocaleString("en")} ${what}${count === 1 ? "" : "s"}`;

const percent = (share) => (share === null ? "" : `${Math.round(100 * share)}\u202f%`);

/** A row of a table, of texts or elements. */
const tableRow = (cells) => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));

/** A table under these headings. */
function table(headings, rows, body = make("tbody", {}, ...rows.map(tableRow)), kind = "scroll") {
  const head = make("tr", {}, ...headings.map((heading) => make("th", { scope: "col" }, heading)));
  return make("div", { class: kind }, make("table", {}, make("thead", {}, head), body));
}

/** What is decided shows at once, and after every change of the decisions. */
function follow(decisions, update) {
  decisions.listeners.push(update);
  update();
}

// Curves as SVG.

const CHART_WIDTH = Math.min(720, Math.max(330, document.documentElement.clientWidth - 24)); // so that its texts can be read on a phone

/** What is measured scan by scan as curves: series [{name, values with null for none}], in a unit. */
function chart(label, unit, xs, series, words = "number of the scan") {
  const [width, height, left, right, top, bottom] = [CHART_WIDTH, 220, 64, 12, 12, 34];
  let [low, high] = [0, 0];
  for (const value of series.flatMap((one) => one.values)) if (value !== null) [low, high] = [Math.min(low, value), Math.max(high, value)];
  if (high === low) high = low + 1;
  const [first, last] = [xs[0], xs[xs.length - 1]];
  const x = (value) => left + ((value - first) / (last - first || 1)) * (width - left - right);
  const y = (value) => height - bottom - ((value - low) / (high - low)) * (height - top - bottom);
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${label} [${unit}]` });
  svg.append(...grid(ticks(low, high), y, [left, width - right], unit));
  for (const tick of ticks(first, last).filter(Number.isInteger)) svg.append(below(x(tick), height - bottom + 16, tick));
  svg.append(below((left + width - right) / 2, height - 3, words));
  svg.append(...series.map(({ values }, s) => curve(xs.map(x), values, y, s)));
  const names = series.map((one, s) => make("span", { class: `key curve-${s}` }, one.name));
  return make("figure", {}, make("figcaption", {}, `${label} [${unit}] `, ...names), svg);
}

/** A text centered under a chart. */
const below = (x, y, text) => make("text", { x, y, "text-anchor": "middle" }, text);

/** Lines across a chart with their numbers to the left. */
const grid = (marks, y, [from, to], unit = "") => marks.flatMap((tick) => [
  make("line", { x1: from, x2: to, y1: y(tick), y2: y(tick), class: tick === 0 ? "zero" : "grid" }),
  make("text", { x: from - 6, y: y(tick) + 4, "text-anchor": "end" }, short(tick, unit)),
]);

/** Curve number s of values, null for none, at places of the picture. */
function curve(places, values, y, s) {
  const point = (value, k) => `${k && values[k - 1] !== null ? "L" : "M"}${places[k].toFixed(1)} ${y(value).toFixed(1)}`;
  const path = values.map((value, k) => (value === null ? "" : point(value, k))).join("");
  return make("path", { d: path, class: `curve curve-${s}` });
}

/** Round numbers from low to high, roughly five of them. */
function ticks(low, high) {
  const rough = (high - low) / 5 || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough);
  const marks = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) marks.push(Number((k * step).toPrecision(12)));
  return marks;
}
