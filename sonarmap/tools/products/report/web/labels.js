// Latitude and longitude of places of a map: the twin of `Georeference.geodetic` in tools/files/geo.py.

const AXIS = 6378137, FLATTENING = 1 / 298.257223563; // of the WGS84 ellipsoid [m]
const ECCENTRICITY = FLATTENING * (2 - FLATTENING); // squared
const ROUNDS = 4; // each leaves a hundredth of the error before, or less

/** [latitude, longitude] [deg] of a place [x, y, z] [m], whose height follows the Earth's curvature. */
function degreesOf([x, y, z], { latitude, longitude, height, heading }) {
  const turn = ((90 - heading) * Math.PI) / 180;
  const east = x * Math.cos(turn) - y * Math.sin(turn), north = x * Math.sin(turn) + y * Math.cos(turn);
  const [phi, lambda] = [latitude, longitude].map((degrees) => (degrees * Math.PI) / 180);
  const wanted = height + z;
  let up = wanted, at;
  for (let round = 0; round < ROUNDS; round++) {
    at = geodetic(centered(east, north, up, phi, lambda));
    up += wanted - at.height;
  }
  return [at.phi, at.lambda].map((angle) => (angle * 180) / Math.PI);
}

const curvature = (phi) => AXIS / Math.sqrt(1 - ECCENTRICITY * Math.sin(phi) ** 2);

/** Earth-centered coordinates [m] of East, North and Up from a point of the ellipsoid. */
function centered(east, north, up, phi, lambda) {
  const [s, c, sl, cl] = [Math.sin(phi), Math.cos(phi), Math.sin(lambda), Math.cos(lambda)];
  const n = curvature(phi);
  const outward = (n + up) * c - north * s; // from the Earth's axis
  return [outward * cl - east * sl, outward * sl + east * cl, (n * (1 - ECCENTRICITY) + up) * s + north * c];
}

function geodetic([x, y, z]) {
  const p = Math.hypot(x, y);
  let phi = Math.atan2(z, p * (1 - ECCENTRICITY)), height = 0;
  for (let round = 0; round < ROUNDS; round++) {
    const n = curvature(phi);
    height = p * Math.cos(phi) + z * Math.sin(phi) - AXIS ** 2 / n;
    phi = Math.atan2(z, p * (1 - (ECCENTRICITY * n) / (n + height)));
  }
  return { phi, lambda: Math.atan2(y, x), height };
}

// What stands over the map: names of places, where the axes point, and how long a bar is.

const BAR = 140; // the longest [pixels]
const MOST_LABELS = 60; // of control points
const [LETTER, LINE] = [7, 19]; // about a letter's width, and a line's height [pixels]

/** Label what the report shows, in this frame. */
function placeLabels(view) {
  const { track } = view.part;
  const last = track.places.length - 1;
  const labels = [];
  if (view.shown.track && last > 0) labels.push(...endLabels(view.camera, track.places[0], track.places[last]));
  if (view.shown.control) labels.push(...controlLabels(view));
  view.measured.forEach((place, k) => labels.push([place, "AB"[k]]));
  if (view.mark && !view.measuring) labels.push([view.mark, "◉"]);
  putLabels(view, labels);
}

/** Put labels, [[place, text], ...], compass and scale where they belong in this frame. */
function putLabels(view, labels) {
  const box = view.stage.querySelector("#labels");
  while (box.children.length < labels.length) box.append(make("span"));
  while (box.children.length > labels.length) box.lastChild.remove();
  const taken = [];
  labels.forEach(([place, text], k) => {
    const [x, , depth] = view.camera.project(place);
    const y = freeHeight(taken, view.camera.project(place), text);
    const label = box.children[k];
    if (label.textContent !== text) label.textContent = text;
    label.className = text === "◉" || text.length === 1 ? "mark" : "";
    label.hidden = depth <= 0;
    label.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
  });
  drawCompass(view);
  drawBar(view);
}

/** Control points that the map was made with. */
const controlLabels = ({ control }) => control.map(({ name, known }) => [known, `△ ${name}`]).slice(0, MOST_LABELS);

/** How high a text may stand [pixels]: lower than its place where it would cover one before it. */
function freeHeight(taken, [x, y], text) {
  const width = text.length * LETTER + 20;
  const covers = (other) => Math.abs(other.y - y) < LINE && x < other.x + other.width && other.x < x + width;
  for (let turn = 0; text.length > 1 && turn < 4 && taken.some(covers); turn++) y += LINE;
  taken.push({ x, y, width });
  return y;
}

/** Where the track starts and ends; one label for both where they would cover each other. */
function endLabels(camera, start, end) {
  const [[x, y], [u, v]] = [start, end].map((place) => camera.project(place));
  const over = Math.abs(x - u) < 46 && Math.abs(y - v) < 18;
  return over ? [[end, "start, end"]] : [[start, "start"], [end, "end"]];
}

function drawCompass({ stage, camera, part }) {
  const { right, up, ahead } = camera.axes();
  const axes = part.axes.map((name, k) => ({ name: name[0], x: 26 * right[k], y: -26 * up[k], away: ahead[k], k }));
  axes.sort((a, b) => b.away - a.away); // what is farther first
  const drawn = axes.flatMap(({ name, x, y, k }) => [
    make("line", { x1: 0, y1: 0, x2: x, y2: y, class: `axis axis-${k}` }),
    make("text", { x: 1.35 * x, y: 1.35 * y + 4, "text-anchor": "middle" }, name),
  ]);
  stage.querySelector("#compass").replaceChildren(...drawn);
}

/** A bar of a round length at the middle of the picture. */
function drawBar({ stage, camera }) {
  const longest = BAR * camera.pixel();
  const power = 10 ** Math.floor(Math.log10(longest));
  const size = [5, 2, 1].map((factor) => factor * power).find((length) => length <= longest);
  const bar = stage.querySelector("#bar");
  bar.style.width = `${(size / camera.pixel()).toFixed(1)}px`;
  bar.firstElementChild.textContent = `${short(size, "m")} at the middle`;
}
