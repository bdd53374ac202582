// The sections under the map, each from the page's content.

const FIRST_ROWS = 50; // of a long list
const WORST = 8; // crossings that are listed
const AXES = ["East", "North", "Up"];

/** All sections that this survey has something for: [[id, heading, elements], ...]; `choose` shows a pair in the map. */
function sectionsOf(content, pictures, decisions, choose) {
  const against = content.control_points.length ? "Against navigation and control points" : "Against navigation";
  const all = [
    ["loops", "Loops", loopSection(content, decisions, choose)],
    ["ties", "Ties by hand", content.names.length > 1 ? tieSection(content, decisions, choose) : []],
    ["poses", "Along the track", content.parts.filter(({ track }) => track.scans.length > 1).flatMap(trackSection)],
    ["crossings", "Crossings of the track", crossingSection(content, choose)],
    ["navigation", against, [...navigationSection(content), ...controlResiduals(content.control_points)]],
    ["pictures", "Pictures", Object.entries(pictures).map(([name, url]) => picture(name, url))],
    ["settings", "Settings", [table(["setting", "value"], content.settings)]],
    ["provenance", "Provenance", provenanceSection(content)],
    ["cite", "How to cite", [make("p", {}, content.citation)]],
  ];
  return all.filter(([, , elements]) => elements.length);
}

const picture = (name, url) =>
  make("figure", {}, make("img", { src: url, alt: `${name}, written with the map` }), make("figcaption", {}, name));

/** The names of a pair's scans; a click shows it in the map. */
const pairLink = (pair, names, choose) => link(`${names[pair.target]}\u00a0– ${names[pair.source]}`, () => choose(pair));

/** Loops, bridges and refused pairs with their reasons; a click on a row shows it in the map. */
function loopSection({ pairs, names }, decisions, choose) {
  if (!pairs.length) return [make("p", {}, "No loops were tried.")];
  const count = make("p", { "aria-live": "polite" });
  const body = make("tbody");
  const more = button("Show all", () => fill(Infinity));
  const search = make("input", { type: "search", placeholder: "scan, kept, refused, or reason", oninput: () => fill() });
  const row = (pair) => {
    const shown = tableRow([pairLink(pair, names, choose), verdictButtons(decisions, pair), pair.role, pair.kept ? "kept" : "refused",
      percent(pair.overlap), percent(pair.probability), short(pair.residual_sigmas, "σ")]);
    shown.append(make("td", { class: "words" }, pair.reason));
    return shown;
  };
  const fill = (most = FIRST_ROWS) => {
    const word = search.value.trim().toLowerCase();
    const texts = (pair) => [names[pair.target], names[pair.source], pair.role, pair.kept ? "kept" : "refused", pair.reason];
    const chosen = pairs.filter((pair) => texts(pair).some((text) => text.toLowerCase().includes(word)));
    body.replaceChildren(...chosen.slice(0, most).map(row));
    more.hidden = chosen.length <= most;
    count.textContent = `${Math.min(most, chosen.length)} of ${chosen.length} pairs`;
  };
  fill();
  const headings = ["scans", "by hand", "role", "verdict", "overlap", "probability", "from the final poses", "reason"];
  return [
    make("p", {}, "Click on a pair to see it in the map; accept or reject it where you know better."),
    make("div", { class: "filter" }, make("label", {}, "Search ", search), count),
    table(headings, [], body, "scroll tall"),
    more,
  ];
}

function trackSection({ name, track }) {
  const sigmas = track.half_axes.map((axes) => axes.map(lengthOf));
  return [
    make("h3", {}, name),
    chart("Overlap", "%", track.scans, [
      { name: "with the scan before", values: track.overlaps.map((share) => (share === null ? null : 100 * share)) },
    ]),
    chart("Standard deviation of the sensor's position", "m", track.scans, [
      { name: "worst direction", values: sigmas.map((sizes) => Math.max(...sizes)) },
      { name: "best direction", values: sigmas.map((sizes) => Math.min(...sizes)) },
    ]),
  ];
}

/** Before the loops and after: of all, and of those that lie farthest apart. */
function crossingSection({ crossings, names }, choose) {
  if (!crossings.pairs) return [];
  const row = (name, suffix) => [name, short(crossings[`before${suffix}`], "m"), short(crossings[`after${suffix}`], "m")];
  const worst = [...crossings.rows].sort((a, b) => b.after_m - a.after_m).slice(0, WORST).map((pair) => [
    pairLink({ ...pair, role: "crossing", kept: true }, names, choose), short(pair.before_m, "m"), short(pair.after_m, "m"), short(pair.after_90_m, "m"),
  ]);
  return [
    make("p", {}, `How far points of one scan lie from the surface of another, over ${crossings.pairs} pairs of scans that
      overlap but were not taken one soon after the other. The ranges' noise is part of it.`),
    table(["distance", "before the loops", "after"], [row("median", ""), row("90th percentile", "_90")]),
    worst.length ? make("p", {}, "Those that lie farthest apart after the loops; click on a pair to see it in the map.") : "",
    worst.length ? table(["scans", "median before", "median after", "90th percentile after"], worst) : "",
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
