// What changes along the track: depth, overlap and standard deviations over the distance, with a cursor that is tied to the map.

const STRIP = 110; // height of a curve's strip [units of the picture]

/** Strips over the distance along the track; `show` is called with the pose that was clicked on. */
function profileChart(part, content, show) {
  const { track, height } = part;
  const along = distances(track, content.surveys);
  const sigmas = track.half_axes.map((axes) => axes.map(lengthOf));
  const strips = [
    { label: height.zero === null ? "height of the sensor" : "depth of the sensor", unit: "m", down: height.zero !== null,
      curves: [["", track.places.map(([, , z]) => (height.zero === null ? z : height.zero - z))]] },
    { label: "overlap with the scan before", unit: "%", floor: 0, curves: [["", track.overlaps.map((share) => (share === null ? null : 100 * share))]] },
    { label: "sigma of its place", unit: "m", floor: 0,
      curves: [["worst direction", sigmas.map((sizes) => Math.max(...sizes))], ["best", sigmas.map((sizes) => Math.min(...sizes))]] },
  ].filter(({ curves }) => curves.some(([, values]) => values.some((value) => value !== null)));
  const [width, left, right] = [CHART_WIDTH, 64, 12];
  const total = strips.length * STRIP + 40;
  const x = (value) => left + (value / (along[along.length - 1] || 1)) * (width - left - right);
  const svg = make("svg", { viewBox: `0 0 ${width} ${total}`, role: "img", tabindex: 0,
    "aria-label": `Along the track of ${part.name}: ${strips.map(({ label }) => label).join(", ")}. Arrow keys go from scan to scan, Enter shows it in the map.` });
  strips.forEach((strip, s) => svg.append(...stripOf(strip, along, x, s * STRIP, [left, width - right])));
  svg.append(...ticks(0, along[along.length - 1] || 1).map((tick) => below(x(tick), total - 22, short(tick, "m"))));
  svg.append(below((left + width - right) / 2, total - 5, "distance along the track"));
  const cursor = make("line", { class: "cursor", y1: 14, y2: total - 38, x1: left, x2: left, visibility: "hidden" });
  svg.append(cursor);
  const said = make("p", { class: "said", role: "status" }, "Point at a place on the track for its numbers; click to see it in the map.");
  const words = (k) => [content.names[track.scans[k]], `${meters(along[k], 0.1)} along`,
    ...strips.flatMap(({ label, unit, curves }) => curves.map(([name, values]) => values[k] !== null && `${name ? `${label}, ${name}` : label} ${short(values[k], unit)}`))].filter(Boolean).join("; ");
  followCursor(svg, along.map(x), width, (k) => {
    cursor.setAttribute("visibility", "visible");
    for (const end of ["x1", "x2"]) cursor.setAttribute(end, x(along[k]).toFixed(1));
    said.textContent = words(k);
  }, show);
  return make("figure", { class: "profile" }, content.parts.length > 1 ? make("figcaption", {}, part.name) : null, svg, said);
}

/** How far each pose lies along the track [m]; the track from one survey to another counts nothing. */
function distances(track, surveys) {
  let far = 0;
  return track.places.map((place, k) => {
    if (k && surveys[track.scans[k]] === surveys[track.scans[k - 1]]) far += lengthOf(minus(place, track.places[k - 1]));
    return far;
  });
}

/** A strip's grid and curves; `down` for what is larger below, `floor` for the least that it shows. */
function stripOf({ label, unit, curves, down, floor }, along, x, top, [from, to]) {
  const values = curves.flatMap(([, each]) => each).filter((value) => value !== null);
  const low = Math.min(floor ?? Infinity, ...values), high = Math.max(...values, low + 1e-9);
  const share = (value) => (value - low) / (high - low);
  const y = (value) => top + 22 + (down ? share(value) : 1 - share(value)) * (STRIP - 34);
  const names = curves.length > 1 ? `: ${curves.map(([name], c) => `${name} (${["solid", "dashed"][c]})`).join(", ")}` : "";
  return [
    make("text", { x: 0, y: top + 13, class: "strip" }, `${label} [${unit}]${names}`),
    ...grid(ticks(low, high, 3), y, [from, to]),
    ...curves.map(([, each], c) => curve(along.map(x), each, y, c)),
  ];
}

/** Call `at` with the pose that is nearest to the pointer, or reached by keys, and `show` with one that is chosen. */
function followCursor(svg, places, width, at, show) {
  let here = 0;
  const go = (k) => at((here = Math.max(0, Math.min(places.length - 1, k))));
  const nearest = (event) => {
    const box = svg.getBoundingClientRect();
    const x = ((event.clientX - box.left) / box.width) * width;
    return places.reduce((best, place, k) => (Math.abs(place - x) < Math.abs(places[best] - x) ? k : best), 0);
  };
  svg.addEventListener("pointermove", (event) => go(nearest(event)));
  svg.addEventListener("click", (event) => {
    go(nearest(event));
    show(here);
  });
  svg.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (step) go(here + step);
    else if (event.key === "Enter") show(here);
    else return;
    event.preventDefault();
  });
}
