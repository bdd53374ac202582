// The page of a comparison: both surveys, with a line that wipes from one to the other, and what changed.

const $ = (selector) => document.querySelector(selector);
const content = JSON.parse($("#content-json").textContent), { regions, clouds: layouts, voxel_m: voxel } = content;
RAMPS.balance = "a50026 d73027 f46d43 fdae61 fee090 ffffbf e0f3f8 abd9e9 74add1 4575b4 313695"; // ColorBrewer's RdYlBu
const DISTANCES = TEXELS; // where the texels of distances begin, behind those of heights
const [UNSAID, MIDDLE, UNSAID_COLOR] = [255, 127, [150, 150, 150]]; // codes of distances, as in page.py
const BEYOND = [1, 2]; // verdicts: gained and lost
const LABELED = 12; // regions with their number; all are outlined
const MODES = { both: ["Old | new", 50], old: ["Old", 100], new: ["New", 0], changes: ["Changes", null] };
const POINTS = { old: "points, old", new: "points, new", changes: "core points" };
const VERDICTS = { unsure: "cannot be said", old_only: "in the old survey only", new_only: "in the new survey only" };
let view = null;

/** The old survey is drawn left of the line, at a share `wipe` of the picture's width, and the new one right of it. */
class WipeScene extends Scene {
  drawClouds(camera, matrix, look, ratio) {
    const { gl } = this, { width, height } = gl.canvas, at = Math.round(this.wipe * width);
    const spans = { old: [0, at], new: [at, width - at], changes: [0, width] }; // where from, and how wide
    gl.enable(gl.SCISSOR_TEST);
    for (const name of look.clouds) {
      gl.scissor(spans[name][0], 0, spans[name][1], height);
      super.drawClouds(camera, matrix, { ...look, clouds: [name] }, ratio);
    }
    gl.disable(gl.SCISSOR_TEST);
  }
}

class ChangesView extends CanvasView {
  /** Of the points of both surveys and of the core points, unpacked: {old, new, changes}. */
  constructor(stage, points) {
    super(stage, WipeScene);
    this.part = { axes: ["x", "y", "z"], voxel };
    this.camera = new Camera(content.extent, content.middle);
    this.resize();
    this.camera.reset(); // as the picture is high and wide now
    const palette = [...ramp("balance").slice(0, -1), UNSAID_COLOR];
    const marks = [-1, 0, 1].map((share) => [MIDDLE * (1 + share), `${signed(share * content.most_m, 2)}\u202fm`]);
    this.colorings = { distance: { label: "distance along the normal: red lost, blue gained", palette, marks } };
    this.scene.usePalette([...ramp("viridis"), ...palette]);
    for (const [name, own] of Object.entries(points)) this.scene.showPoints(name, own);
    this.colorChanges(false);
    this.choose(null);
    followKeys(this, { Escape: () => this.choose(null) });
  }

  /** Colors of core points: `only` of those that are beyond their level of detection. */
  colorChanges(only) {
    const { places, count, columns: { distance, verdict } } = this.scene.clouds.get("changes").points;
    const code = (k) => (only && distance[k] !== UNSAID && !BEYOND.includes(verdict[k]) ? MIDDLE : distance[k]);
    for (let k = 0; k < count; k++) places[4 * k + 3] = DISTANCES + code(k);
    this.scene.upload("changes");
    this.request();
  }

  /** Colors of the surveys, by height: around the region that is chosen, so that a small change is seen. */
  colorSurveys() {
    const { chosen } = this, beyond = Math.max(voxel / 2, 1.5 * Math.abs(chosen?.height_m));
    const range = chosen ? [chosen.lowest_m[2] - beyond, chosen.highest_m[2] + beyond] : content.height_range;
    const height = { range, zero: null, label: "height in the frame of the old survey" };
    for (const name of ["old", "new"]) {
      const { points } = this.scene.clouds.get(name);
      this.colorings.height = byHeight({ height }, points);
      for (let k = 0; k < points.count; k++) points.places[4 * k + 3] = this.colorings.height.color(k);
      this.scene.upload(name);
    }
  }

  /** Show the old survey in so many percent of the picture, and the new one in the rest; null for the changes. */
  wipe(percent) {
    const survey = percent !== null, before = this.mode;
    if (survey) [this.scene.wipe, $("#wipe").value, $("#line").style.left] = [percent / 100, percent, `${percent}%`];
    this.mode = { null: "changes", 0: "new", 100: "old" }[percent] ?? "both";
    for (const each of $("#modes").children) each.setAttribute("aria-pressed", each.dataset.mode === this.mode);
    for (const [id, on] of [["wipe", survey], ["line", survey], ["beyond", !survey]]) $(`#${id}`).hidden = !on;
    if (this.mode !== before) this.explain();
    this.request(true);
  }

  /** Mark a region and fly there; null for none. */
  choose(region) {
    this.chosen = region;
    for (const row of $("#regions").querySelectorAll("tbody tr"))
      row.setAttribute("aria-current", row.dataset.number === String(region?.number));
    this.colorSurveys();
    this.explain();
    if (!region) return;
    this.stage.scrollIntoView({ block: "nearest" });
    const { camera } = this, size = lengthOf(minus(region.highest_m, region.lowest_m)) + 4 * voxel;
    this.fly(region.place_m, 3 * size * Math.max(1, camera.height / camera.width));
  }

  /** The legend, and the boxes around regions, black or white as the ground needs it. */
  explain() {
    const changes = this.mode === "changes", ink = changes || this.ground()[0] > 0.5 ? 0 : 1, legend = $("#legend");
    this.coloring = changes ? "distance" : "height";
    showLegend(legend, this);
    if (changes) legend.append(make("p", {}, make("span", { class: "patch unsaid" }), "cannot be said"));
    const [plain, bright] = [[ink, ink, ink], [0.9, 0.1, 0.65]], own = this.chosen ? boxOf(this.chosen) : [];
    this.scene.showLines("regions", regions.flatMap(boxOf), { color: plain, width: 1.2, hidden: 0.5 });
    this.scene.showLines("chosen", own, { color: bright, width: 3, hidden: 0.75 });
    this.request();
  }

  click(x, y, near) {
    this.choose(regions[placeAt(regions.map((region) => region.place_m), this.camera, x, y, 2 * near)] ?? null);
  }

  clouds() {
    return this.mode === "changes" ? ["changes"] : ["old", "new"];
  }

  label() {
    const { chosen } = this, others = regions.slice(0, LABELED).filter((region) => region !== chosen);
    const named = chosen ? [[chosen.highest_m, `${chosen.number}: ${volumeOf(chosen)}\u202fm³`]] : [];
    putLabels(this, [...named, ...others.map(({ place_m: place, number }) => [place, `${number}`])]);
  }
}

const signed = (value, digits) => `${value > 0 ? "+" : ""}${value.toFixed(digits).replace("-", "−")}`;
const volumeOf = (region) => `${signed(region.volume_m3, 1)}\u202f±\u202f${region.volume_sigma_m3.toFixed(1)}`;

/** The edges of the box around a region, a voxel apart from it. */
function boxOf({ lowest_m: low, highest_m: high }) {
  const corner = (k) => [0, 1, 2].map((axis) => ((k >> axis) & 1 ? high[axis] + voxel : low[axis] - voxel));
  const from = (k) => [1, 2, 4].filter((bit) => !(k & bit)).map((bit) => [corner(k), corner(k | bit)]);
  return [...Array(8).keys()].flatMap(from);
}

function showTable() {
  const rows = regions.map((region) => {
    const numbers = [region.area_m2.toFixed(1), signed(region.height_m, 2), volumeOf(region)];
    const kind = make("td", {}, make("span", { class: `patch ${region.kind}` }), region.kind);
    const cells = [make("td", {}, link(region.number, () => {})), kind, ...numbers.map((text) => make("td", {}, text))];
    return make("tr", { "data-number": region.number, onclick: () => view?.choose(region) }, ...cells);
  });
  const filled = table(["", "", "area [m²]", "height [m]", "volume [m³]"], [], make("tbody", {}, ...rows));
  $("#regions").append(rows.length ? filled : "No change is beyond its error.");
}

function showFacts() {
  const { alignment: how, level_of_detection_m: level } = content, number = (count) => count.toLocaleString("en");
  const aligned = how && `${how.agreeing} of ${counted(how.views, "view")} agree on how the surveys lie`;
  const facts = [
    ["old survey", content.old], ["new survey", content.new], ["alignment", aligned ?? "none: the frames were kept"],
    ["level of detection", level === null ? "nothing could be compared" : `${meters(level)} (median, 95\u202f%)`],
    ...Object.entries(content.areas_m2).map(([name, area]) => [VERDICTS[name] ?? name, short(area, "m²")]),
    ...content.notes.map((note) => ["note", note]),
    ...Object.entries(layouts).map(([name, { count, all }]) =>
      [POINTS[name], count < all ? `${number(count)} of ${number(all)}, chosen at random` : number(all)]),
  ];
  $("#facts").append(...facts.flatMap(([name, value]) => [make("dt", {}, name), make("dd", {}, value)]));
}

function withoutView(why) {
  view = null;
  const words = `The surveys cannot be shown in 3D: ${why}. Below is changes.png, the changes from above.`;
  for (const useless of ["#controls", "#keys"]) $(useless).remove();
  $("#stage").replaceWith(make("p", { class: "notice" }, words));
}

showTable();
showFacts();
followTheme(() => view?.explain());
try {
  const points = {};
  for (const [k, [name, { packed }]] of Object.entries(layouts).entries())
    points[name] = await unpack(packed, $(`#points-${k}`).textContent);
  view = new ChangesView($("#stage"), points);
  view.canvas.addEventListener("webglcontextlost", () => withoutView("the graphics driver stopped"));
  for (const [mode, [text, percent]] of Object.entries(MODES))
    $("#modes").append(button(text, () => view.wipe(percent), { "data-mode": mode }));
  view.wipe(50);
  $("#wipe").addEventListener("input", ({ target }) => view.wipe(Number(target.value)));
  $("#beyond input").addEventListener("change", ({ target }) => view.colorChanges(target.checked));
  $("#looks").append(button("From above", () => (view.camera.fromAbove(), view.request())),
    button("Show all", () => (view.choose(null), view.camera.reset(), view.request())));
  $("#opening").hidden = true;
} catch (error) {
  withoutView(error.message);
}
window.sonarmap = { content, view }; // for scripts that measure in the page
