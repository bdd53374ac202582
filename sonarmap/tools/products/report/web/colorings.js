// By what points can be colored: which color each gets, and what the legend says.

// matplotlib's viridis, whose colors people with any kind of color vision can tell apart.
const VIRIDIS = "440154 48186a 472d7b 424086 3b528b 33638d 2c728e 26828e 21918c 1fa088 28ae80 3fbc73 5ec962 84d44b addc30 d8e219 fde725"
  .split(" ").map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));
const [UNKNOWN_TEXEL, LAST_TEXEL] = [255, 256]; // of what is not known, and of the last scan
const PALETTE = Array.from({ length: 255 }, (_, k) => {
  const at = (k / 254) * (VIRIDIS.length - 1), before = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[before].map((value, c) => Math.round(value + (at - before) * (VIRIDIS[before + 1][c] - value)));
}).concat([[128, 128, 128], [255, 64, 176]]);

/** Colorings of a part: {name: {label, texel: point's number to its color, or null for its height's, marks: texts along the colors}}. */
function coloringsOf(part, { columns }) {
  const { label, zero, range: [low, high] } = part.height;
  const all = { depth: byNumber(label, low, high, (z) => meters(zero === null ? z : zero - z, (high - low) / 100)) };
  if (columns.echo) all.echo = byCode("echo strength (as the sonar gives it)", columns.echo, part.scales.echo, "");
  all.sigma = byCode("standard deviation of a point's coordinates", columns.sigma, part.scales.sigma, "m");
  const [most] = quantiles(columns.seen, 0.99);
  all.seen = {
    label: "number of scans that saw a point",
    texel: (k) => clamped((254 * (columns.seen[k] - 1)) / Math.max(1, most - 1)),
    marks: ["1 scan", most > 1 ? `${most} scans${most === 255 ? " or more" : ""}` : ""],
  };
  return all;
}

/** By a number that the card works out, between two of them, which the legend words. */
function byNumber(label, low, high, worded) {
  return { label, texel: null, marks: [low, (low + high) / 2, high].map(worded) };
}

/** By a column of codes as points.py makes them, whose extremes these are. */
function byCode(label, codes, scale, unit) {
  const known = codes.filter(Boolean), [low, high] = known.length ? quantiles(known, 0.01, 0.99) : [1, 1];
  const texel = (k) => (codes[k] ? clamped((254 * (codes[k] - low)) / (high - low || 1)) : UNKNOWN_TEXEL);
  const mark = (share) => short(valueOf(low + share * (high - low), scale), unit);
  return { label, texel, marks: [0, 0.5, 1].map(mark) };
}

/** The number that a code stands for: 1 for the smaller of the extremes, 255 for the larger, in equal ratios. */
function valueOf(code, [low, high]) {
  return low * (high / low) ** ((code - 1) / 254);
}

const clamped = (texel) => Math.max(0, Math.min(254, Math.round(texel)));

/** Numbers at these shares of a list, in ascending order. */
function quantiles(values, ...shares) {
  const sorted = Float64Array.from(values).sort();
  return shares.map((share) => sorted[Math.round(share * (sorted.length - 1))]);
}

function showLegend(box, { label, marks }) {
  const css = (texel) => `rgb(${PALETTE[texel].join(" ")})`;
  const scale = make("div", { class: "scale" });
  scale.style.background = `linear-gradient(to right, ${[0, 32, 64, 95, 127, 159, 191, 222, 254].map(css).join(", ")})`;
  box.replaceChildren(make("p", {}, label), scale, make("div", { class: "marks" }, ...marks.map((text) => make("span", {}, text))));
}
