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

/** About so many round numbers from low to high. */
function ticks(low, high, about = 5) {
  const rough = (high - low) / about || 1;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough);
  const marks = [];
  for (let k = Math.ceil(low / step); k * step <= high + 1e-9 * step; k++) marks.push(Number((k * step).toPrecision(12)));
  return marks;
}
