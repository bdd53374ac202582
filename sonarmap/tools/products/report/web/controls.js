// The form beside the map, and what it says of what was picked.

/** Fill the form for the part that is shown; `change` shows another part, by its number. */
function showControls(form, view, content, number, change) {
  const select = (label, options, chosen, onchange) =>
    make("label", {}, label, make("select", { onchange: (event) => onchange(event.target.value) },
      ...options.map(([value, text]) => make("option", { value, selected: value === chosen }, text))));
  const parts = content.parts.map((part, k) => [k, `${part.name}: ${part.count.toLocaleString("en")} points`]);
  const height = view.part.height.zero === null ? "height" : "depth";
  const colorings = Object.keys(view.colorings).map((name) => [name, name === "depth" ? height : name]);
  const legend = make("div", { id: "legend" });
  form.replaceChildren(
    parts.length > 1 ? select("Part of the map ", parts, number, (value) => change(Number(value))) : "",
    select("Color by ", colorings, view.coloring, (name) => {
      view.colorBy(name);
      showLegend(legend, view.colorings[name]);
    }),
    legend,
    make("fieldset", {}, make("legend", {}, "Show"), ...layerBoxes(view),
      ...[["lowest", 0, "Hide below: "], ["highest", 1, "Hide above: "]].map(([id, end, text]) => heightSlider(view, id, end, text))),
    make("div", { class: "buttons" },
      button("Measure a distance", () => view.measure(!view.measuring), { id: "measure", "aria-pressed": view.measuring }),
      button("From above", () => (view.camera.fromAbove(), view.request())),
      button("Show all", () => (view.camera.reset(), view.request()))));
  showLegend(legend, view.colorings[view.coloring]);
}

/** A box for every layer that this part has. */
function layerBoxes(view) {
  const kept = view.pairs.filter((pair) => pair.kept).length, refused = view.pairs.length - kept;
  const enlarged = (factor) => (factor > 1 ? `, ${factor} times as large` : "");
  const layers = {
    points: "points",
    track: "track of the sensor",
    ellipsoids: `ellipsoids (95 %)${enlarged(view.factor)}`,
    kept: kept && `${counted(kept, "loop")} kept`,
    refused: refused && `${counted(refused, "pair")} refused`,
    decided: "ties by hand",
    control: view.control.length && `control points, residuals${enlarged(view.exaggeration)}`,
  };
  const change = (name, on) => {
    view.shown[name] = on;
    view.showLayers();
  };
  return Object.entries(layers).filter(([, text]) => text).map(([name, text]) => {
    const { width, dash, color } = LINES[name] ?? LINES.accepted, swatch = make("span");
    if (name !== "points") swatch.style.borderTop = `${Math.max(1, width)}px ${dash ? "dashed" : "solid"} rgb(${color.map((value) => 255 * value).join(" ")})`;
    return make("label", { class: "layer" },
      make("input", { type: "checkbox", checked: view.shown[name], onchange: (event) => change(name, event.target.checked) }), text, swatch);
  });
}

/** A slider that cuts points off at a height: at its outer end, nothing. */
function heightSlider(view, id, end, text) {
  const { extent, height } = view.part;
  const [low, high] = [extent[0][2], extent[1][2]];
  const said = make("output", {}, "off");
  const slider = make("input", {
    type: "range", id, min: 0, max: 200, value: 200 * end, oninput: () => {
      const share = slider.value / 200;
      const z = low + share * (high - low);
      view.heights[end] = share === end ? (end ? Infinity : -Infinity) : z;
      said.textContent = share === end ? "off" : meters(height.zero === null ? z : height.zero - z, (high - low) / 100);
      view.request();
    },
  });
  return make("label", {}, text, said, slider);
}

function showPicked(box, view, content, hit) {
  document.querySelector("#measure")?.setAttribute("aria-pressed", view.measuring);
  const close = button("×", () => view.leave(), { class: "close", "aria-label": "Close" });
  box.replaceChildren(...(hit ? [close, ...pickedRows(view, content, hit)] : []));
}

function pickedRows(view, content, hit) {
  if ("measuring" in hit) return [make("p", {}, ["Click on the first point.", "Click on the second point."][hit.measuring])];
  if ("tying" in hit)
    return [make("p", {}, `Click on the place of the scan that ${content.names[hit.tying]} is tied to, in any part of the map. Esc ends it.`)];
  if (hit.distance) return [distanceList(view, hit.distance)];
  if (hit.pair)
    return [...pairRows(content, hit.pair), make("p", { class: "decide" }, "By hand: ", verdictButtons(view.decisions, hit.pair))];
  return hit.place ? [pointList(view, content, hit)] : poseRows(view, content, hit.pose);
}

function list(title, rows) {
  const known = rows.filter((row) => row && row[1] !== "");
  return make("div", {}, make("h3", {}, title), make("dl", {}, ...known.flatMap(([name, text]) => [make("dt", {}, name), make("dd", {}, text)])));
}

function distanceList(view, [a, b]) {
  const step = view.points.quantum;
  const [dx, dy, dz] = minus(b, a);
  const bearing = (((Math.atan2(dx, dy) * 180) / Math.PI + 360) % 360).toFixed(1);
  return list("Distance from A to B", [
    ["distance", meters(lengthOf([dx, dy, dz]), step)],
    ["level", meters(Math.hypot(dx, dy), step)],
    ["up", meters(dz, step)],
    view.part.axes[0] === "East" && ["bearing from North", `${bearing}°`],
    ["read to", `± ${meters(step * Math.sqrt(3), step / 10)}: coordinates are whole numbers of ${meters(step, step / 10)}`],
  ]);
}

function placeRows(view, place, step) {
  const { axes, height, on_earth } = view.part;
  const rows = axes.map((name, k) => [name, meters(place[k], step)]);
  if (height.zero !== null) rows.push([height.label, meters(height.zero - place[2], step)]);
  if (on_earth) {
    const [latitude, longitude] = degreesOf(place, view.content.georeference);
    rows.push(["latitude (WGS84)", `${latitude.toFixed(7)}°`], ["longitude (WGS84)", `${longitude.toFixed(7)}°`]);
  }
  return rows;
}

function pointList(view, content, { point, place }) {
  const { columns } = view.points, { scales } = view.part;
  const value = (name, unit) => (columns[name]?.[point] ? short(valueOf(columns[name][point], scales[name]), unit) : "");
  const several = new Set(content.surveys).size > 1;
  const { track } = view.part, scan = columns.scan[point];
  const inScan = toSensor(poseOf(track, track.scans.indexOf(scan)), place).map((x) => meters(x, view.points.quantum)).join(", ");
  return list("Point", [
    ...placeRows(view, place, view.points.quantum),
    ["standard deviation", value("sigma", "m")],
    ["echo", value("echo")],
    ["seen by", counted(columns.seen[point], "scan")],
    ["mostly by", content.names[scan]],
    ["x, y, z in that scan", inScan], // as --control takes them
    several && ["of survey", columns.survey[point]],
  ]);
}

function poseRows(view, content, k) {
  const { track } = view.part;
  const sigmas = track.half_axes[k].map(lengthOf);
  const tie = button("Tie to another scan", () => view.tie(track.scans[k]));
  const said = list("Sensor", [
    ["scan", content.names[track.scans[k]]],
    ...placeRows(view, track.places[k], 0.001),
    ["standard deviation", `${short(Math.max(...sigmas), "m")} in the worst direction, ${short(Math.min(...sigmas), "m")} in the best`],
  ]);
  return content.names.length > 1 ? [said, tie] : [said];
}

function pairRows(content, pair) {
  const scans = ["scans", `${content.names[pair.target]} and ${content.names[pair.source]}`];
  if (pair.role === "crossing")
    return [list("Crossings of the track", [scans,
      ["before the loops", `${short(pair.before_m, "m")} apart (median), ${short(pair.before_90_m, "m")} (90th percentile)`],
      ["after", `${short(pair.after_m, "m")} apart (median), ${short(pair.after_90_m, "m")} (90th percentile)`],
    ])];
  if (pair.role === "new") return [list("Two scans", [scans, ["reason", pair.reason]])];
  return [list(`${pair.role === "loop" ? "Loop" : "Pair"} ${pair.kept ? "kept" : "refused"}`, [
    scans,
    ["reason", pair.reason],
    ["overlap", percent(pair.overlap)],
    ["probability", percent(pair.probability)],
    ["off the estimate before it", short(pair.sigmas_from_estimate, "σ")],
    ["off the final poses", short(pair.residual_sigmas, "σ")],
  ])];
}
