// What was received of the dive; the twin of messages.py. Nothing here draws.

const SAMPLES = 64; // points of a cloud that its extent and the colors are taken from
const STEPS = 20000; // samples of all clouds at most

class Dive {
  constructor() {
    this.state = { status: "waiting", sentence: "Waiting for the first scan.", alerts: [], part: 0, own: 0 };
    this.poses = []; // of key scans: {part, place [m], turn: quaternion x, y, z, w}
    this.clouds = new Map(); // {key scan: {key, quantum [m], places: Int16Array of x, y, z [quanta], count}}
    this.loops = [];
    this.coverage = new Map(); // {part: {corner [m], size [m], legend, picture}}
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
    else content.poses.forEach(([part, x, y, z, ...turn], k) => (this.poses[content.first + k] = { part, place: [x, y, z], turn }));
    return { kind: content.kind };
  }

  takePoints(buffer) {
    const head = new DataView(buffer), places = new Int16Array(buffer, 12); // every machine with a browser is little-endian
    const cloud = { key: head.getUint32(4, true), quantum: head.getFloat32(8, true), places, count: places.length / 3 };
    if (head.getUint8(0) === 2) return { kind: "last", cloud: (this.last = cloud) };
    this.clouds.set(cloud.key, cloud);
    return { kind: "cloud", cloud };
  }

  /** A place in a key scan's frame [m], in the frame of its part. */
  placed(key, place) {
    const pose = this.poses[key];
    return sum(turned(pose.turn, place), pose.place);
  }

  /** Whether a key scan's pose is known, in this part. */
  isIn(part, key) {
    return this.poses[key]?.part === part;
  }

  /** Clouds of key scans in this part. */
  cloudsIn(part) {
    return [...this.clouds.values()].filter(({ key }) => this.isIn(part, key));
  }

  /** Points of this part, about evenly chosen, in its frame [m]. */
  samples(part) {
    const clouds = this.cloudsIn(part), each = Math.max(4, Math.min(SAMPLES, Math.floor(STEPS / (clouds.length || 1))));
    return clouds.flatMap(({ key, quantum, places, count }) => Array.from({ length: Math.min(each, count) }, (_, k) => {
      const at = 3 * Math.floor((k * count) / Math.min(each, count));
      return this.placed(key, [0, 1, 2].map((axis) => quantum * places[at + axis]));
    }));
  }

  /** Lines between these pairs of key scans, of those that are in this part. */
  between(part, pairs) {
    return pairs.filter((pair) => pair.every((key) => this.isIn(part, key))).map((pair) => pair.map((key) => this.poses[key].place));
  }

  /** The track from key scan to key scan, without those of a finished map. */
  trackPieces(part) {
    return this.between(part, this.poses.map((_, key) => [key - 1, key]).slice(this.state.own + 1));
  }
}

// The dive in 3D: the map of a part, the vehicle in it, and the camera that follows it until the user moves it.

const STATUS_COLORS = { placed: [0, 0.62, 0.45], uncertain: [0.9, 0.62, 0], lost: [0.9, 0.1, 0.1] };
const UNKNOWN_COLOR = [0.55, 0.55, 0.55]; // of a vehicle that waits, or whose dive has ended
const ARROW = 30; // half its length [pixels]
const REFRESH = 300; // between two looks at all points and lines [ms]
const ASIDE = 0.5; // of the vehicle's heading, so that the arrow hides less [rad]
const LAST_TEXEL = 256, LAST_COLOR = [255, 64, 176]; // behind the palette, of the last scan

class LiveView extends MapView {
  constructor(stage, dive) {
    super(stage);
    Object.assign(this, { dive, follow: true, chosen: null, span: 5 });
    this.part = { number: 0, axes: ["x", "y", "z"] };
    this.range = [0, 1]; // heights at the ends of the palette [m]
    this.scene.usePalette([...ramp("viridis"), LAST_COLOR]);
    followKeys(this, { Home: () => this.showAll() });
    this.refresh();
  }

  /** Show what a message changed; all that there is after `reset`. */
  show({ kind, cloud }) {
    if (kind === "reset") this.scene.forgetPoints();
    if (cloud) this.scene.showPoints(kind === "last" ? "last" : `${cloud.key}`, cloud);
    if (kind === "last") this.measureLast(cloud);
    if (!["last", "coverage"].includes(kind)) this.refreshing ??= setTimeout(() => this.refresh(), this.frames ? REFRESH : 0);
    this.request();
  }

  /** The middle of the last scan, in its key scan's frame, and how far around the vehicle there is something to see [m]. */
  measureLast({ places, quantum, count }) {
    this.middle = [0, 0, 0];
    for (let k = 0; k < places.length; k++) this.middle[k % 3] += (quantum * places[k]) / count;
    this.span = Math.max(1, 2.5 * lengthOf(this.middle));
  }

  click() {}

  /** Follow the vehicle, in its part and looking ahead over it, or stay. */
  setFollow(on) {
    [this.follow, this.aimed] = [on, false];
    if (on) this.chosen = null;
    this.refresh();
  }

  /** Step back until all is seen, from where the camera looks. */
  showAll() {
    const { azimuth } = this.camera;
    this.camera.reset();
    [this.camera.azimuth, this.camera.distance] = [azimuth, 1.2 * this.camera.distance];
  }

  /** Look at all points of the part anew: its extent, its colors, and the lines. */
  refresh() {
    this.refreshing = null;
    const { dive } = this, number = (this.part.number = this.chosen ?? dive.state.part), samples = dive.samples(number);
    if (samples.length) {
      const axes = [0, 1, 2].map((axis) => Float64Array.from(samples, (place) => place[axis]).sort());
      const corners = (...shares) => shares.map((share) => axes.map((axis) => axis[Math.round(share * (axis.length - 1))]));
      this.camera.cover(corners(0, 1), corners(0.01, 0.99));
      this.range = corners(0.01, 0.99).map((corner) => corner[2]);
    }
    this.coloring = byHeight("height in the frame of this map", ...this.range, (z) => meters(z, 0.1));
    this.scene.showLines("track", dive.trackPieces(number), LINES.track);
    this.scene.showLines("kept", dive.between(number, dive.loops), LINES.kept);
    this.changed?.();
    this.request();
  }

  /** The last sure place and the vehicle {place, turn}, where they are in the part that is shown. */
  seen() {
    const { part, pose, sure } = this.dive.state, { number } = this.part;
    return {
      vehicle: pose && part === number ? { place: pose.slice(0, 3), turn: pose.slice(3) } : null,
      sure: sure?.[0] === number ? sure[1] : null,
    };
  }

  /** Arrow and ellipsoid, and where to go back to; the labels of these. */
  showVehicle() {
    const { camera, scene } = this, { status, half_axes } = this.dive.state, { vehicle, sure } = this.seen();
    const color = STATUS_COLORS[status] ?? UNKNOWN_COLOR, size = ARROW * camera.pixel(), lost = status === "lost" && sure;
    const at = (...corner) => sum(vehicle.place, turned(vehicle.turn, corner.map((value) => value * size)));
    const corners = vehicle ? [at(-0.7, 0.5, 0), at(-0.7, 0, 0.35), at(-0.7, -0.5, 0)] : [];
    const edges = corners.flatMap((corner, k) => [[at(1, 0, 0), corner], [corner, corners[(k + 1) % 3]]]);
    const around = vehicle ? ellipsoidPieces({ places: [vehicle.place], half_axes: [half_axes] }, 1) : [];
    scene.showLines("ellipsoids", around, { color, width: 1.5, hidden: 0.5 });
    scene.showLines("back", lost && vehicle ? [[vehicle.place, sure]] : [], { color, width: 2, dash: 8, hidden: 0.8 });
    scene.showLines("sure", lost ? crosses([sure], 14 * camera.pixel()) : [], { color, width: 5, hidden: 0.9 });
    scene.showLines("vehicle", edges, { color, width: 4, hidden: 0.9 });
    return [...(vehicle ? [[vehicle.place, `vehicle, ${status}`]] : []), ...(lost ? [[sure, "last sure place"]] : [])];
  }

  /** Ask for a frame; `moved` if the user moved the camera. */
  request(moved = false) {
    if (moved && this.follow) this.setFollow(false);
    super.request();
  }

  /** Every key scan in its own frame: when a loop closes, its pose changes, and no point. */
  look() {
    if (this.follow) this.followVehicle();
    const { dive, part: { number }, range } = this, { last } = dive;
    const cloudOf = (name, { key, count }, more) => {
      const { place: origin, turn } = dive.poses[key];
      return { name, tiles: [{ start: 0, count, origin, turn }], ...more };
    };
    const clouds = dive.cloudsIn(number).map((cloud) => cloudOf(`${cloud.key}`, cloud));
    if (last && dive.isIn(number, last.key)) clouds.push(cloudOf("last", last, { texel: LAST_TEXEL, larger: 1.4, step: 1 }));
    return { clouds, voxel: 0.003 * this.span, range, labels: this.showVehicle() };
  }

  /** Look at the vehicle and what it sees now, or at where it was last sure. */
  followVehicle() {
    const { camera, dive } = this, { vehicle, sure } = this.seen(), { last } = dive, place = vehicle?.place ?? sure;
    if (!place) return;
    const middle = last && dive.isIn(this.part.number, last.key) ? dive.placed(last.key, this.middle) : place;
    const far = Math.max(1, Math.min(camera.reach, this.span)) * Math.max(1, camera.height / camera.width);
    camera.lookAt(sum(place, middle).map((value) => value / 2), 1.8 * far);
    if (vehicle && !this.aimed) {
      const [x, y] = turned(vehicle.turn, [1, 0, 0]);
      [camera.azimuth, this.aimed] = [Math.atan2(x, y) + ASIDE, true];
    }
  }
}
