// What was received of the dive; the twin of messages.py. Nothing here draws.

const SAMPLES = 64; // points of a cloud that its extent and the colors are taken from
const STEPS = 8000; // samples of all clouds at most
const RIM_SAMPLES = 600; // of the last scan, that its range and its angles are taken from

class Dive {
  constructor() {
    this.state = { status: "waiting", sentence: "Waiting for the first scan.", alerts: [], choices: [], part: 0, own: 0 };
    this.poses = []; // of key scans: {part, place [m], turn: quaternion x, y, z, w, sigma: of the place [m]}
    this.clouds = new Map(); // {key scan: {key, quantum [m], places: Int16Array of x, y, z [quanta], count}}
    this.loops = [];
    this.coverage = new Map(); // {part: {corner [m], size [m], legend, picture, holes: [[x, y], ...] [m]}}
    this.making = ""; // how far the final map is, in words
    this.last = null; // the last scan, as a cloud
  }

  /** Take a message in; what it changed: its kind, and of a cloud the cloud. */
  take(message) {
    if (typeof message !== "string") return this.takePoints(message);
    const content = JSON.parse(message);
    if (content.kind === "reset") Object.assign(this, new Dive());
    else if (content.kind === "state") this.state = content;
    else if (content.kind === "loops") this.loops = content.pairs;
    else if (content.kind === "coverage") this.coverage.set(content.part, content);
    else if (content.kind === "making") this.making = content.words;
    else content.poses?.forEach(([part, sigma, x, y, z, ...turn], k) =>
      (this.poses[content.first + k] = { part, place: [x, y, z], turn, sigma }));
    return { kind: content.kind };
  }

  takePoints(buffer) {
    const head = new DataView(buffer), places = new Int16Array(buffer, 12); // every machine with a browser is little-endian
    const cloud = { key: head.getUint32(4, true), quantum: head.getFloat32(8, true), places, count: places.length / 3 };
    if (head.getUint8(0) === 2) return { kind: "last", cloud: (this.last = cloud) };
    this.clouds.set(cloud.key, cloud);
    return { kind: "cloud", cloud };
  }

  cloudsIn(part) {
    return [...this.clouds.values()].filter(({ key }) => this.poses[key]?.part === part);
  }

  /** Point k of a cloud, in the frame of its part [m]. */
  pointOf({ key, quantum, places }, k) {
    return fromSensor(this.poses[key], [0, 1, 2].map((axis) => quantum * places[3 * k + axis]));
  }

  /** Points of a cloud, evenly chosen, in the frame of its part [m]. */
  samplesOf(cloud, most) {
    const count = Math.min(most, cloud.count);
    return Array.from({ length: count }, (_, k) => this.pointOf(cloud, Math.floor((k * cloud.count) / count)));
  }

  samples(part) {
    const clouds = this.cloudsIn(part), each = Math.max(4, Math.min(SAMPLES, Math.floor(STEPS / (clouds.length || 1))));
    return clouds.flatMap((cloud) => this.samplesOf(cloud, each));
  }

  /** Lines between these pairs of key scans, of those that are in this part. */
  between(part, pairs) {
    return pairs.filter((pair) => pair.every((key) => this.poses[key]?.part === part)).map((pair) => pair.map((key) => this.poses[key].place));
  }

  /** The track from key scan to key scan, without those of a finished map. */
  trackPieces(part) {
    return this.between(part, this.poses.map((_, key) => [key - 1, key]).slice(this.state.own + 1));
  }
}

// The dive in 3D: the map of a part, the vehicle in it, and the camera that follows it until the user moves it.

const STATUS_COLORS = { placed: [0, 0.62, 0.45], uncertain: [0.9, 0.62, 0], lost: [0.9, 0.1, 0.1] };
const UNKNOWN_COLOR = [0.55, 0.55, 0.55]; // of a vehicle that waits, or whose dive has ended
const LENGTH = 0.46, LEAST = 34; // of a small vehicle [m], and as it is drawn at least [pixels]
const REFRESH = 300; // between two looks at all points and lines [ms]
const HALFWAY = 350; // time in which the camera that follows comes half the way [ms]
const BEHIND = { distance: 1.6, elevation: 0.62 }; // where it follows: away from what is seen [ranges], over it [rad]
const [NEARLY_ALL, MOST] = [0.99, 0.95]; // shares of the last scan's points that its range and its angles hold
const WIDE = 0.009; // edge of a point [ranges]

class LiveView extends MapView {
  constructor(stage, dive) {
    super(stage);
    Object.assign(this, { dive, follow: true, chosen: null, colored: "height" });
    this.field = { far: 5, pans: [0, 0], tilts: [0, 0] }; // seen by the last scan from the vehicle: range [m], angles [rad]
    this.part = { number: 0, axes: ["x", "y", "z"] };
    followKeys(this);
    this.refresh();
  }

  /** Show what a message changed; all that there is after `reset`. */
  show({ kind, cloud }) {
    if (kind === "reset") this.scene.clouds.clear();
    if (cloud) this.scene.showPoints(kind === "last" ? "last" : `${cloud.key}`, cloud);
    if (["last", "state"].includes(kind)) this.measureField();
    const stays = kind === "state" ? this.part.number === (this.chosen ?? this.dive.state.part) : ["last", "coverage"].includes(kind);
    if (!stays) this.refreshing ??= setTimeout(() => this.refresh(), this.frames ? REFRESH : 0);
    this.request();
  }

  measureField() {
    const { last } = this.dive, { vehicle } = this.seen();
    if (!vehicle || !last?.count || this.dive.poses[last.key]?.part !== this.part.number) return;
    const own = this.dive.samplesOf(last, RIM_SAMPLES).map((place) => toSensor(vehicle, place));
    const rim = [(1 - MOST) / 2, (1 + MOST) / 2];
    this.field = {
      far: Math.max(1, ...quantiles(own.map(lengthOf), NEARLY_ALL)),
      pans: quantiles(own.map(([x, y]) => Math.atan2(y, x)), ...rim),
      tilts: quantiles(own.map(([x, y, z]) => Math.atan2(z, Math.hypot(x, y))), ...rim),
    };
  }

  /** Follow the vehicle, in its part and looking ahead over it, or stay. */
  setFollow(on) {
    [this.follow, this.followed] = [on, null];
    if (on) this.chosen = null;
    this.refresh();
  }

  /** Color by what is named, or by the next. */
  colorBy(name) {
    const names = Object.keys(this.colorings);
    this.colored = name ?? names[(names.indexOf(this.colored) + 1) % names.length];
    this.refresh();
  }

  /** Look at all points of the part anew: its extent, its colors, and the lines. */
  refresh() {
    this.refreshing = null;
    const { dive } = this, number = (this.part.number = this.chosen ?? dive.state.part), samples = dive.samples(number);
    let heights = [0, 1];
    if (samples.length) {
      const axes = [0, 1, 2].map((axis) => quantiles(samples.map((place) => place[axis]), 0, 1, 0.01, 0.99, 0.03, 0.97));
      const corner = (k) => axes.map((values) => values[k]);
      this.camera.cover([corner(0), corner(1)], [corner(2), corner(3)]);
      heights = axes[2].slice(4);
    }
    this.colorings = this.coloringsBetween(heights, dive.cloudsIn(number).map(({ key }) => key));
    this.scene.showLines("track", dive.trackPieces(number), LINES.track);
    this.scene.showLines("kept", dive.between(number, dive.loops), LINES.kept);
    this.changed?.();
    this.request();
  }

  /** Colorings by their names, with numbers `of` a key scan where all of its points have one color, at the `ends` of the palette. */
  coloringsBetween(heights, keys) {
    const by = (label, ends, worded, of) => ({ ...byNumber(label, ...ends, worded), ends, of });
    const sigmas = keys.map((key) => this.dive.poses[key].sigma), newest = Math.max(0, ...keys);
    return {
      height: by("height in the frame of this map", heights, (z) => meters(z, 0.1)),
      distance: by("distance from the vehicle", [0, 1.5 * this.field.far], (far) => meters(far, 0.1)),
      age: by("age, in key scans", [newest - Math.min(newest, ...keys), 0], (age) => age.toFixed(), (key) => newest - key),
      uncertainty: by("standard deviation of the place", [0, Math.max(1e-3, ...sigmas)], (sigma) => meters(sigma), (key) => this.dive.poses[key].sigma),
    };
  }

  /** The last sure place and the vehicle {place, turn}, where they are in the part that is shown. */
  seen() {
    const { part, pose, sure } = this.dive.state, { number } = this.part;
    return {
      vehicle: pose && part === number ? { place: pose.slice(0, 3), turn: pose.slice(3) } : null,
      sure: sure?.[0] === number ? sure[1] : null,
    };
  }

  /** The vehicle to scale, its ellipsoid and field of view, and where to go back to; the labels of these. */
  showVehicle() {
    const { camera, scene } = this, { status, half_axes } = this.dive.state, { vehicle, sure } = this.seen();
    const color = STATUS_COLORS[status] ?? UNKNOWN_COLOR, size = Math.max(LENGTH, LEAST * camera.pixel()), lost = status === "lost" && sure;
    const at = (...corner) => sum(vehicle.place, turned(vehicle.turn, corner.map((value) => value * size)));
    const corners = vehicle ? [at(-0.4, 0.35, 0), at(-0.4, 0, 0.3), at(-0.4, -0.35, 0)] : [];
    const edges = corners.flatMap((corner, k) => [[at(0.6, 0, 0), corner], [corner, corners[(k + 1) % 3]]]);
    const around = vehicle ? ellipsoidPieces({ places: [vehicle.place], half_axes: [half_axes] }, 1) : [];
    scene.showLines("ellipsoids", around, { color, width: 1.5, hidden: 0.5 });
    scene.showLines("field", vehicle ? this.fieldPieces(vehicle) : [], LINES.field);
    scene.showLines("back", lost && vehicle ? [[vehicle.place, sure]] : [], { color, width: 2, dash: 8, hidden: 0.8 });
    scene.showLines("sure", lost ? crosses([sure], 14 * camera.pixel()) : [], { color, width: 5, hidden: 0.9 });
    scene.showLines("vehicle", edges, { color, width: 4, hidden: 0.9 });
    return [...(vehicle ? [[vehicle.place, `vehicle, ${status}`]] : []), ...(lost ? [[sure, "last sure place"]] : [])];
  }

  /** The rim of what the last scan saw, and lines from the vehicle to its corners. */
  fieldPieces({ place, turn }) {
    const { far, pans: [first, last], tilts } = this.field;
    const at = (pan, tilt) => sum(place, turned(turn, [Math.cos(tilt) * Math.cos(pan), Math.cos(tilt) * Math.sin(pan), Math.sin(tilt)]), far);
    const pan = (k) => first + (k / CIRCLE) * (last - first);
    const rims = tilts.flatMap((tilt) => Array.from({ length: CIRCLE }, (_, k) => [at(pan(k), tilt), at(pan(k + 1), tilt)]));
    return [...rims, ...[first, last].flatMap((side) => [tilts.map((tilt) => at(side, tilt)), ...tilts.map((tilt) => [place, at(side, tilt)])])];
  }

  /** Ask for a frame; `moved` if the user moved the camera. */
  request(moved = false) {
    if (moved && this.follow) this.setFollow(false);
    super.request();
  }

  /** Every key scan in its own frame: when a loop closes, its pose changes, and no point. */
  look() {
    if (this.follow) this.followVehicle(performance.now());
    const { dive, part: { number } } = this, { last } = dive, { ends, of } = this.colorings[this.colored];
    const tileOf = ({ key, count }) => ({ start: 0, count, origin: dive.poses[key].place, turn: dive.poses[key].turn });
    const texelOf = (key) => clamped((254 * (of(key) - ends[0])) / (ends[1] - ends[0] || 1));
    const clouds = dive.cloudsIn(number).map((cloud) =>
      ({ name: `${cloud.key}`, tiles: [tileOf(cloud)], texel: of ? texelOf(cloud.key) : BY_HEIGHT }));
    if (last && dive.poses[last.key]?.part === number) clouds.push({ name: "last", tiles: [tileOf(last)], texel: LAST_TEXEL, larger: 0.7, whole: true });
    const from = this.colored === "distance" ? this.seen().vehicle?.place : null;
    return { clouds, voxel: WIDE * this.field.far, range: ends, from, labels: this.showVehicle() };
  }

  /** Look over the vehicle at what it sees, or at where it was last sure; turn and move smoothly there. */
  followVehicle(now) {
    const { camera, dive, field: { far } } = this, { vehicle, sure } = this.seen(), place = vehicle?.place ?? sure;
    if (!place) return;
    const [x, y] = vehicle ? turned(vehicle.turn, [1, 0, 0]) : [0, 0], wide = Math.max(1, camera.height / camera.width);
    const turn = vehicle ? Math.atan2(x, y) - camera.azimuth : 0;
    const away = minus(sum(place, [x, y, 0], far / 2), camera.target), further = BEHIND.distance * far * wide - camera.distance;
    const near = this.followed && lengthOf([...away, further]) < camera.distance;
    const share = near ? 1 - 2 ** ((this.followed - now) / HALFWAY) : 1;
    camera.turn(share * Math.atan2(Math.sin(turn), Math.cos(turn)), share * (BEHIND.elevation - camera.elevation));
    camera.lookAt(sum(camera.target, away, share), camera.distance + share * further);
    this.followed = now;
    if (lengthOf([...away, further]) > 0.003 * far || Math.abs(Math.sin(turn / 2)) > 0.001) this.request();
  }
}
