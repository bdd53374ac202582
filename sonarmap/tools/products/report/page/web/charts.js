// Curves as SVG.

const CHART_WIDTH = Math.min(720, Math.max(330, document.documentElement.clientWidth - 24)); // so that its texts can be read on a phone

/** What is measured scan by scan as curves: series [{name, values with null for none}], in a unit. */
function chart(label, unit, xs, series, below = "number of the scan") {
  const [width, height, left, right, top, bottom] = [CHART_WIDTH, 220, 64, 12, 12, 34];
  let [low, high] = [0, 0];
  for (const value of series.flatMap((one) => one.values)) if (value !== null) [low, high] = [Math.min(low, value), Math.max(high, value)];
  if (high === low) high = low + 1;
  const [first, last] = [xs[0], xs[xs.length - 1]];
  const x = (value) => left + ((value - first) / (last - first || 1)) * (width - left - right);
  const y = (value) => height - bottom - ((value - low) / (high - low)) * (height - top - bottom);
  const svg = make("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": `${label} [${unit}]` });
  for (const tick of ticks(low, high)) {
    svg.append(make("line", { x1: left, x2: width - right, y1: y(tick), y2: y(tick), class: tick === 0 ? "zero" : "grid" }));
    svg.append(make("text", { x: left - 6, y: y(tick) + 4, "text-anchor": "end" }, short(tick, unit)));
  }
  for (const tick of ticks(first, last).filter(Number.isInteger))
    svg.append(make("text", { x: x(tick), y: height - bottom + 16, "text-anchor": "middle" }, tick));
  svg.append(make("text", { x: (left + width - right) / 2, y: height - 3, "text-anchor": "middle" }, below));
  series.forEach((one, s) => {
    let path = "";
    one.values.forEach((value, k) => {
      if (value !== null) path += `${k && one.values[k - 1] !== null ? "L" : "M"}${x(xs[k]).toFixed(1)} ${y(value).toFixed(1)}`;
    });
    svg.append(make("path", { d: path, class: `curve curve-${s}` }));
  });
  const names = series.map((one, s) => make("span", { class: `key curve-${s}` }, one.name));
  return make("figure", {}, make("figcaption", {}, `${label} [${unit}] `, ...names), svg);
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
