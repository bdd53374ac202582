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

// The sections under the map, each from the page's content.

const FIRST_ROWS = 50; // of a long list
const WORST = 8; // crossings that are listed
const AXES = ["East", "North", "Up"];

/** All sections that this survey has something for: [[id, heading, elements], ...]; `choose` and `showPose` show in the map. */
function sectionsOf(content, pictures, decisions, choose, showPose) {
  const tracks = content.parts.map((part, number) => [part, number]).filter(([{ track }]) => track.scans.length > 1);
  const against = content.control_points.length ? "Against navigation and control points" : "Against navigation";
  const all = [
    ["loops", "Loops", loopSection(content, decisions, choose)],
    ["ties", "Ties by hand", content.names.length > 1 ? tieSection(content, decisions, choose) : []],
    ["poses", "Along the track", tracks.map(([part, number]) => profileChart(part, content, (k) => showPose(number, k)))],
    ["crossings", "Crossings of the track", crossingSection(content, choose)],
    ["navigation", against, [...navigationSection(content), ...controlResiduals(content.control_points)]],
    ["pictures", "Pictures", Object.entries(pictures).map(([name, url]) => picture(name, url))],
    ["settings", "Settings", [table(["setting", "value"], content.settings)]],
    ["provenance", "Provenance", provenanceSection(content)],
    ["cite", "How to cite", [make("p", {}, content.citation)]],
  ];
  return all.filter(([, , elements]) => elements.length);
}

function picture(name, url) {
  return make("figure", {}, make("img", { src: url, alt: `${name}, written with the map` }), make("figcaption", {}, name));
}

/** The names of a pair's scans; a click shows it in the map. */
const pairLink = (pair, names, choose) => link(`${names[pair.target]}\u00a0– ${names[pair.source]}`, () => choose(pair));

/** Loops, bridges and refused pairs with their reasons; a click on a row shows it in the map. */
function loopSection({ pairs, names }, decisions, choose) {
  if (!pairs.length) return [make("p", {}, "No loops were tried.")];
  const count = make("p", { "aria-live": "polite" });
  const body = make("tbody");
  const more = button("Show all", () => fill(Infinity));
  const verdict = choice(["all", "kept", "refused"].map((value) => [value, value]), { onchange: () => fill() }, "all");
  const search = make("input", { type: "search", placeholder: "a scan, or a word of a reason", oninput: () => fill() });
  const row = (pair) => {
    const shown = tableRow([pairLink(pair, names, choose), verdictButtons(decisions, pair), pair.role, pair.kept ? "kept" : "refused",
      percent(pair.overlap), percent(pair.probability), short(pair.residual_sigmas, "σ")]);
    shown.append(make("td", { class: "words" }, pair.reason));
    return shown;
  };
  const fill = (most = FIRST_ROWS) => {
    const word = search.value.trim().toLowerCase();
    const chosen = pairs.filter((pair) =>
      (verdict.value === "all" || pair.kept === (verdict.value === "kept")) &&
      [names[pair.target], names[pair.source], pair.role, pair.reason].some((text) => text.toLowerCase().includes(word)));
    body.replaceChildren(...chosen.slice(0, most).map(row));
    more.hidden = chosen.length <= most;
    count.textContent = `${Math.min(most, chosen.length)} of ${chosen.length} pairs`;
  };
  fill();
  const headings = ["scans", "by hand", "role", "verdict", "overlap", "probability", "from the final poses", "reason"];
  return [
    make("p", {}, "Click on a pair to see it in the map; accept or reject it where you know better."),
    make("div", { class: "filter" }, make("label", {}, "Show ", verdict), make("label", {}, "Search ", search), count),
    table(headings, [], body, "scroll tall"),
    more,
  ];
}

/** Before the loops and after: of all, as a curve, and of those that lie farthest apart. */
function crossingSection({ crossings, names }, choose) {
  if (!crossings.pairs) return [];
  const row = (name, suffix) => [name, short(crossings[`before${suffix}`], "m"), short(crossings[`after${suffix}`], "m")];
  return [
    make("p", {}, `How far points of one scan lie from the surface of another, over ${crossings.pairs} pairs of scans that
      overlap but were not taken one soon after the other. The ranges' noise is part of it.`),
    table(["distance", "before the loops", "after"], [row("median", ""), row("90th percentile", "_90")]),
    ...(crossings.rows.length ? crossingRows(crossings.rows, names, choose) : []),
  ];
}

function crossingRows(rows, names, choose) {
  const sorted = (name, key) => ({ name, values: rows.map((row) => row[key]).sort((a, b) => a - b) });
  const worst = [...rows].sort((a, b) => b.after_m - a.after_m).slice(0, WORST);
  const line = (row) => [
    pairLink({ ...row, role: "crossing", kept: true }, names, choose),
    short(row.before_m, "m"), short(row.after_m, "m"), short(row.after_90_m, "m"),
  ];
  return [
    chart("Median distance at a crossing", "m", rows.map((_, k) => k + 1),
      [sorted("after", "after_m"), sorted("before the loops", "before_m")], "crossings, from the smallest distance to the largest"),
    make("p", {}, "Those that lie farthest apart after the loops; click on a pair to see it in the map."),
    table(["scans", "median before", "median after", "90th percentile after"], worst.map(line)),
  ];
}

function provenanceSection({ versions, device, inputs, georeference, graph, parts }) {
  const rows = Object.entries(versions).map(([name, version]) => [name, version ?? "not installed"]);
  if (device) rows.push(["device", `${device.name}, ${device.platform}`]);
  if (georeference) {
    const { latitude, longitude, height, vertical, heading } = georeference;
    rows.push(["origin of the map", `latitude ${latitude}°, longitude ${longitude}° (WGS84), height ${short(height, "m")} (${vertical}), x axis to ${heading}°`]);
  }
  for (const part of parts) rows.push([part.name, `${part.count.toLocaleString("en")} points, voxels of ${short(part.voxel, "m")}`]);
  rows.push(["pose graph", `${graph.edges} edges; chi-squared ${short(graph.chi_squared_after)} for ${graph.degrees_of_freedom} degrees of freedom`]);
  const files = inputs.map(({ name, bytes, sha256 }) => [name, bytes === null ? "could not be read" : bytes.toLocaleString("en"), sha256 ?? ""]);
  return [
    table(["what", "which"], rows),
    make("details", {}, make("summary", {}, `${files.length} input files with their SHA-256`), table(["file", "bytes", "SHA-256"], files)),
  ];
}

/** How far the map lies from what instruments measured. */
function navigationSection({ navigation }) {
  const { names, units, rows } = navigation;
  if (!rows.length) return [];
  const xs = rows.map((row) => row.scan);
  const charts = [["deg", "Attitude, map less instruments"], ["m", "Position, map less instruments"]].map(([unit, label]) => {
    const measured = names.map((_, k) => k).filter((k) => units[k] === unit && rows.some((row) => row.apart[k] !== null));
    return measured.length ? chart(label, unit, xs, measured.map((k) => ({ name: names[k], values: rows.map((row) => row.apart[k]) }))) : null;
  });
  const spread = (k) => {
    const known = rows.filter((row) => row.apart[k] !== null);
    const rms = (name) => Math.sqrt(known.reduce((total, row) => total + row[name][k] ** 2, 0) / known.length);
    return known.length ? [names[k], short(rms("apart"), units[k]), short(rms("sigmas"), units[k]), `${known.length}`] : null;
  };
  return [
    ...charts.filter(Boolean),
    table(["measured", "root mean square of the difference", "standard deviation it was given", "scans"],
      names.map((_, k) => spread(k)).filter(Boolean)),
  ];
}

/** How far the map's points lie from the known places. */
function controlResiduals(points) {
  if (!points.length) return [];
  const rms = (rows, of) => short(Math.sqrt(rows.reduce((total, row) => total + of(row) ** 2, 0) / rows.length), "m");
  const uses = [["control", "the map is held to them"], ["check", "only compared"]].map(([use, words]) =>
    [use, words, points.filter((row) => row.use === use && row.counted)]);
  const signed = (value) => `${value < 0 ? "−" : "+"}${meters(Math.abs(value), 0.001)}`;
  return [
    make("h3", {}, "Control points"),
    table(["rms of map less known", ...AXES, "all three", "points"], uses.filter(([, , rows]) => rows.length).map(([use, words, rows]) =>
      [`${use} (${words})`, ...[0, 1, 2].map((k) => rms(rows, (row) => row.residual[k])), rms(rows, (row) => lengthOf(row.residual)), rows.length])),
    table(["map less known", ...AXES, "distance", "in sigmas", "use", "scan"], points.map((row) =>
      [row.name, ...row.residual.map(signed), meters(lengthOf(row.residual), 0.001), short(row.in_sigmas, "σ"),
        `${row.use}${row.left_out ? ", left out: the others contradict it" : row.counted ? "" : ", in a part that is not in the world"}`, row.scan])),
  ];
}
