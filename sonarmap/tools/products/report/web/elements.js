// Elements of the page and numbers in words. Every text, whatever file it comes from, becomes a text node: never markup.

const $ = (selector) => document.querySelector(selector);

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

const button = (text, onclick, more = {}) => make("button", { type: "button", onclick, ...more }, text);

const link = (text, onclick) => button(text, onclick, { class: "link" });

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

const tableRow = (cells) => make("tr", {}, ...cells.map((cell) => make("td", {}, cell)));

function table(headings, rows, body = make("tbody", {}, ...rows.map(tableRow)), kind = "scroll") {
  const head = make("tr", {}, ...headings.map((heading) => make("th", { scope: "col" }, heading)));
  return make("div", { class: kind }, make("table", {}, make("thead", {}, head), body));
}

/** What is decided shows at once, and after every change of the decisions. */
function follow(decisions, update) {
  decisions.listeners.push(update);
  update();
}

const CHART_WIDTH = Math.min(720, Math.max(330, document.documentElement.clientWidth - 24)); // so that its texts can be read on a phone

/** What is measured scan by scan as curves: series [{name, values with null for none}], in a unit. */
function chart(label, unit, xs, series) {
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
  svg.append(below((left + width - right) / 2, height - 3, "number of the scan"));
  svg.append(...series.map(({ values }, s) => curve(xs.map(x), values, y, s)));
  const names = series.map((one, s) => make("span", { class: `key curve-${s}` }, one.name));
  return make("figure", {}, make("figcaption", {}, `${label} [${unit}] `, ...names), svg);
}

const below = (x, y, text) => make("text", { x, y, "text-anchor": "middle" }, text);

const grid = (marks, y, [from, to], unit = "") => marks.flatMap((tick) => [
  make("line", { x1: from, x2: to, y1: y(tick), y2: y(tick), class: tick === 0 ? "zero" : "grid" }),
  make("text", { x: from - 6, y: y(tick) + 4, "text-anchor": "end" }, short(tick, unit)),
]);

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
