// By what points can be colored: which color each gets, and what the legend says.

/** The colorings of a part of the map: {name: {label, palette, color: point's number to a texel, marks: [[texel, text], ...]}}. */
function coloringsOf(part, points) {
  const { columns } = points;
  const all = { depth: byHeight(part, points) };
  if (columns.echo) all.echo = byCode("echo strength (as the sonar gives it)", "cividis", columns.echo, part.scales.echo, "");
  all.sigma = byCode("standard deviation of a point's coordinates", "magma", columns.sigma, part.scales.sigma, "m");
  const most = quantile(columns.seen, 0.99);
  all.seen = {
    label: "number of scans that saw a point",
    palette: ramp("plasma"),
    color: (k) => Math.min(254, Math.round((254 * (columns.seen[k] - 1)) / Math.max(1, most - 1))),
    marks: [[0, "1 scan"], [254, most > 1 ? `${most} scans${most === 255 ? " or more" : ""}` : ""]],
  };
  return all;
}

function byHeight(part, points) {
  const { range: [low, high], zero } = part.height;
  const shown = (z) => meters(zero === null ? z : zero - z, (high - low) / 100);
  const heights = new Float32Array(points.count);
  for (const { start, count, origin } of points.tiles)
    for (let k = start; k < start + count; k++) heights[k] = origin[2] + points.quantum * points.places[4 * k + 2];
  const color = (k) => clamped((254 * (heights[k] - low)) / (high - low || 1));
  const marks = [[0, shown(low)], [127, shown((low + high) / 2)], [254, shown(high)]];
  return { label: part.height.label, palette: ramp("viridis"), color, marks };
}

/** By a column of codes as points.py makes them, whose extremes these are. */
function byCode(label, palette, codes, scale, unit) {
  const [low, high] = [quantile(codes, 0.01), quantile(codes, 0.99)];
  const texel = (code) => (code ? clamped((254 * (code - low)) / (high - low || 1)) : 255);
  const mark = (share) => [254 * share, short(valueOf(low + share * (high - low), scale), unit)];
  return { label, palette: ramp(palette), color: (k) => texel(codes[k]), marks: [0, 0.5, 1].map(mark) };
}

/** The number that a code stands for: 1 for the smaller of the extremes, 255 for the larger, in equal ratios. */
function valueOf(code, [low, high]) {
  return low * (high / low) ** ((code - 1) / 254);
}

const clamped = (texel) => Math.max(0, Math.min(254, Math.round(texel)));

/** A quantile of the codes that are known. */
function quantile(codes, share) {
  const counts = new Array(256).fill(0);
  for (const code of codes) counts[code]++;
  counts[0] = 0;
  let left = share * counts.reduce((sum, count) => sum + count, 0);
  const at = counts.findIndex((count) => count && (left -= count) <= 0);
  return at < 0 ? 1 : at;
}
