// Control points by hand: points of the map that the user names, their known places as far as they are known, and the file.

const KNOWN = ["East", "North", "Up"];
const FARTHEST = 20000; // East or North beyond this are coordinates of a grid [m]

const USES = [["control", "to hold the map"], ["check", "only to check it"]];

/** A number as JavaScript and CSV have it, of what a user typed; Number("") is 0. */
const decimal = (text) => text.trim().replace(",", ".");

/** A number as the file has it, or "" for none; an Error for what is no number. */
function numberOf(text, what) {
  const number = decimal(text);
  if (!Number.isFinite(Number(number))) throw new Error(`${what} is "${text}"; wanted a number, or nothing. No file was saved.`);
  return number;
}

/** Whether a point's known place is in a grid's coordinates, not the map's. */
const isFar = ({ known }) => known.slice(0, 2).some((text) => Math.abs(Number(decimal(text))) > FARTHEST);
const inGrid = (control) => control.some(isFar);

/** The control points as a file; columns that no point needs are left out. */
function controlFile({ control, content }) {
  const grid = inGrid(control);
  const known = grid ? ["easting_m", "northing_m", "height_m"] : ["east_m", "north_m", "up_m"];
  const mixed = control.find((row) => row.known[0].trim() !== "" && isFar(row) !== grid);
  if (mixed) throw new Error(`${mixed.name} is in the map's coordinates, and others are in a grid's; wanted one of them for all. No file was saved.`);
  const sigmas = control.some(({ sigma_up }) => sigma_up.trim()) ? ["sigma_h_m", "sigma_v_m"] : ["sigma_m"];
  const uses = control.some(({ use }) => use === "check") ? ["use"] : [];
  const rows = control.map((row) => {
    const sigma = numberOf(row.sigma, `The standard deviation of ${row.name}`);
    const up = numberOf(row.sigma_up, `The standard deviation of ${row.name} upward`) || sigma;
    return {
      name: row.name, scan: row.scan, x_m: row.point[0], y_m: row.point[1], z_m: row.point[2],
      ...Object.fromEntries(known.map((column, k) => [column, numberOf(row.known[k], `${KNOWN[k]} of ${row.name}`)])),
      sigma_m: sigma, sigma_h_m: sigma, sigma_v_m: up, use: row.use,
    };
  });
  const columns = ["name", "scan", "x_m", "y_m", "z_m", ...known, ...sigmas, ...uses];
  return csvOf(`control points for sonarmap map --control, named in the report of: ${content.title}`, columns, rows);
}

/** Fields for what the user knows of a control point; `sync` of each shows what was typed elsewhere. */
function controlFields(decisions, row, changed = () => {}) {
  const bad = (text) => !Number.isFinite(Number(decimal(text)));
  const field = (label, of, key, wide = false) => {
    const input = make("input", { type: "text", inputmode: wide ? "text" : "decimal", size: wide ? 12 : 8, "aria-label": `${label} of ${row.name}`,
      oninput: () => {
        of[key] = input.value;
        input.setAttribute("aria-invalid", !wide && bad(input.value));
        decisions.keep();
        changed();
      },
      onchange: () => decisions.changed() });
    input.sync = () => (input.value = of[key]);
    input.sync();
    return make("label", {}, `${label} `, input);
  };
  const choose = () => {
    row.use = use.value;
    decisions.changed();
  };
  const use = choice(USES, { "aria-label": `use of ${row.name}`, onchange: choose }, row.use);
  use.sync = () => (use.value = row.use);
  return [
    field("name", row, "name", true),
    ...KNOWN.map((axis, k) => field(`${axis} [m]`, row.known, k)),
    field("sigma [m]", row, "sigma"),
    row.sigma_up ? field("sigma upward [m]", row, "sigma_up") : "",
    make("label", {}, "use ", use),
  ];
}

/** The fields of a point that was just named, beside the map. */
function namedForm(decisions, row, view) {
  return make("div", { class: "named" }, make("h3", {}, `Control point of ${row.scan}`),
    ...controlFields(decisions, row, () => view.request()),
    make("p", {}, "Known coordinates may stay empty, and be filled in in control.csv."));
}

function controlSection(content, decisions) {
  const body = make("div");
  const line = (row) => make("li", {},
    make("span", {}, `${row.scan}: ${row.point.map((value, k) => `${"xyz"[k]} ${meters(value, 0.001)}`).join(", ")}`),
    ...controlFields(decisions, row),
    button("remove", () => decisions.remove("control", row)));
  let shown = [];
  const fill = () => {
    const { control } = decisions;
    for (const field of body.querySelectorAll("input, select")) field.sync();
    if (shown.length && shown.length === control.length && shown.every((row, k) => row === control[k])) return; // who types there goes on
    shown = [...control];
    body.replaceChildren(control.length ? make("ul", { class: "named-points" }, ...control.map(line)) : make("p", {}, "No point is named yet."));
  };
  follow(decisions, fill);
  return [
    make("p", {}, `Points of the map whose true place you know, such as a corner of a quay. Click on a point in the map, then on
      "Name as a control point". East, North and Up are meters from the map's origin, or coordinates of a grid. The file holds it in the frame of the scan that saw it most (x ahead, y left, z up), so that
      it follows the scan wherever the next map places it.`),
    body,
    ...fileButtons(decisions, "control", () => controlFile(decisions)),
    commandBox(decisions),
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
    table(["rms of map less known", ...KNOWN, "all three", "points"], uses.filter(([, , rows]) => rows.length).map(([use, words, rows]) =>
      [`${use} (${words})`, ...[0, 1, 2].map((k) => rms(rows, (row) => row.residual[k])), rms(rows, (row) => lengthOf(row.residual)), rows.length])),
    table(["map less known", ...KNOWN, "distance", "in sigmas", "use", "scan"], points.map((row) =>
      [row.name, ...row.residual.map(signed), meters(lengthOf(row.residual), 0.001), short(row.in_sigmas, "σ"),
        `${row.use}${row.left_out ? ", left out: the others contradict it" : row.counted ? "" : ", in a part that is not in the world"}`, row.scan])),
  ];
}
