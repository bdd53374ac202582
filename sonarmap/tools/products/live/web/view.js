// The dive in 3D: the map of a part, the vehicle in it, and the camera that follows it until the user moves it.

const LAST_TEXEL = 256, LAST_COLOR = [255, 64, 176]; // behind the palette, of the last scan
const STATUS_COLORS = { placed: [0, 0.62, 0.45], uncertain: [0.9, 0.62, 0], lost: [0.9, 0.1, 0.1] };
const UNKNOWN_COLOR = [0.55, 0.55, 0.55]; // of a vehicle that waits, or whose dive has ended
const ARROW = 30; // half its length [pixels]
const STROKES = 12; // that fill a face of it
const REFRESH = 300; // between two looks at all points and lines [ms]
const MOST_PIECES = 4000; // of the track
const ASIDE = 0.5; // of the vehicle's heading, so that the arrow hides less [rad]
const [SLOW, SLOW_NEWS, QUICK] = [50, 120, 20]; // a frame while the user moves, one for news, one with time to spare [ms]
const FEWEST = 32; // every how many points a slow machine draws at most: WebGL allows no wider steps
const STILL = 1000, STEADY = 30; // without news for so long all points are drawn [ms]; quick frames before more are [frames]

class LiveView {
  constructor(stage, dive) {
    Object.assign(this, { stage, dive, follow: true, chosen: null, frames: 0, step: 1, quick: 0, span: 5, movedAt: -Infinity });
    this.canvas = stage.querySelector("canvas");
    this.scene = new CloudScene(this.canvas);
    this.part = { number: 0, axes: ["x", "y", "z"] };
    this.range = [0, 1]; // heights at the ends of the palette [m]
    this.camera = new Camera([[-5, -5, -5], [5, 5, 5]], [[-5, -5, -5], [5, 5, 5]]);
    this.colorings = { height: { palette: ramp("viridis") } };
    this.coloring = "height";
    this.scene.usePalette([...this.colorings.height.palette, LAST_COLOR]);
    new ResizeObserver(() => this.resize()).observe(stage);
    followPointer(this);
    followKeys(this, { Home: () => this.showAll() });
    this.refresh();
  }

  /** Show what a message changed; all that there is after `reset`. */
  show({ kind, cloud }) {
    if (kind === "reset") this.scene.forget();
    if (cloud) this.scene.showPoints(kind === "last" ? "last" : `${cloud.key}`, cloud);
    if (kind === "last") this.measureLast(cloud);
    if (kind !== "last" && kind !== "coverage") this.refreshing ??= setTimeout(() => this.refresh(), this.frames ? REFRESH : 0);
    this.request();
  }

  /** The middle of the last scan, in its key scan's frame, and how far around the vehicle there is something to see [m]. */
  measureLast({ places, quantum, count }) {
    const all = [0, 0, 0];
    for (let k = 0; k < places.length; k++) all[k % 3] += quantum * places[k];
    this.middle = all.map((value) => value / (count || 1));
    this.span = Math.max(1, 2.5 * lengthOf(this.middle));
  }

  click() {}

  /** Follow the vehicle, looking ahead over it, or stay. */
  setFollow(on) {
    this.follow = on;
    this.aimed = false;
    this.request();
    this.changed?.();
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
    const { dive } = this, number = this.chosen ?? dive.state.part ?? 0;
    this.part.number = number;
    const samples = dive.samples(number);
    if (samples.length) {
      const axes = [0, 1, 2].map((axis) => Float64Array.from(samples, (place) => place[axis]).sort());
      const corners = (...shares) => shares.map((share) => axes.map((axis) => axis[Math.round(share * (axis.length - 1))]));
      this.camera.cover(corners(0, 1), corners(0.01, 0.99));
      this.range = [0.01, 0.99].map((share) => axes[2][Math.round(share * (samples.length - 1))]);
    }
    const marks = [0, 0.5, 1].map((share) => [254 * share, meters(this.range[0] + share * (this.range[1] - this.range[0]), 0.1)]);
    Object.assign(this.colorings.height, { label: "height in the frame of this map", marks });
    this.scene.showLines("track", dive.trackPieces(number, MOST_PIECES), LINES.track);
    this.scene.showLines("kept", dive.loopPieces(number), LINES.kept);
    this.changed?.();
    this.request();
  }

  /** The last sure place, if it is in the part that is shown [m]. */
  sure() {
    const { last_sure: sure } = this.dive.state;
    return sure && sure.part === this.part.number ? sure.place : null;
  }

  /** The vehicle, if it is in the part that is shown. */
  vehicle() {
    const { vehicle, part } = this.dive.state;
    return vehicle && part === this.part.number ? vehicle : null;
  }

  /** Arrow and ellipsoid, and where to go back to. */
  showVehicle() {
    const { camera, scene } = this, { status } = this.dive.state, vehicle = this.vehicle(), sure = this.sure();
    const color = STATUS_COLORS[status] ?? UNKNOWN_COLOR;
    const place = vehicle?.pose.slice(0, 3), size = ARROW * camera.pixel();
    const at = (x, y, z) => sum(place, turned(vehicle.pose.slice(3), [x * size, y * size, z * size]));
    const corners = vehicle ? [at(-0.7, 0.5, 0), at(-0.7, 0, 0.35), at(-0.7, -0.5, 0)] : [];
    const edges = corners.flatMap((corner, k) => [[at(1, 0, 0), corner], [corner, corners[(k + 1) % 3]]]);
    const faces = corners.flatMap((corner, k) => Array.from({ length: STROKES }, (_, n) =>
      [at(1, 0, 0), sum(corner, minus(corners[(k + 1) % 3], corner), n / STROKES)]));
    const own = vehicle ? ellipsoidPieces({ places: [place], half_axes: [halfAxes(vehicle.covariance)] }, 1) : [];
    const lost = status === "lost" && sure;
    scene.showLines("ellipsoids", own, { color, width: 1.5, hidden: 0.5 });
    scene.showLines("back", lost && place ? [[place, sure]] : [], { color, width: 2, dash: 8, hidden: 0.8 });
    scene.showLines("sure", lost ? crosses([sure], 14 * camera.pixel()) : [], { color, width: 5, hidden: 0.9 });
    scene.showLines("faces", faces, { color, width: 4, hidden: 0.9 });
    scene.showLines("edges", edges, { color: this.ground(), width: 1.5, hidden: 0.9 });
    return [...(place ? [[place, `vehicle, ${status}`]] : []), ...(lost ? [[sure, "last sure place"]] : [])];
  }

  ground() {
    return getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g).slice(0, 3).map((value) => value / 255);
  }

  /** Ask for a frame; `moved` if the user moved the camera. */
  request(moved = false) {
    if (moved) this.movedAt = performance.now();
    if (moved && this.follow) this.setFollow(false);
    this.waiting ??= requestAnimationFrame((now) => this.draw(now));
  }

  draw(now) {
    this.waiting = null;
    clearTimeout(this.resting);
    const step = this.still ? 1 : this.step, thinned = step > 1;
    this.still = false;
    if (thinned) this.resting = setTimeout(() => ((this.still = true), this.request()), STILL);
    const { camera, dive, scene } = this;
    if (this.follow) this.followVehicle();
    const clouds = [...scene.clouds].filter(([, { points }]) => points.count && dive.isIn(this.part.number, points.key)).map(([name]) => name);
    const labels = this.showVehicle();
    const look = { ground: this.ground(), clouds, voxel: 0.003 * this.span, scale: 1, step, poses: dive.poses, range: this.range };
    scene.draw(camera, { ...look, texels: { last: LAST_TEXEL } });
    putLabels(this, labels);
    this.frames++;
    if (thinned || this.step === 1) requestAnimationFrame((next) => this.fit(next - now)); // which comes when this one is drawn
  }

  /** Look at the vehicle and what it sees now, or at where it was last sure. */
  followVehicle() {
    const { camera, dive } = this, vehicle = this.vehicle(), last = dive.last;
    const place = vehicle?.pose.slice(0, 3) ?? this.sure();
    if (!place) return;
    const middle = last && dive.isIn(this.part.number, last.key) ? dive.placed(last.key, this.middle) : place;
    const far = Math.max(1, Math.min(camera.reach, this.span)) * Math.max(1, camera.height / camera.width);
    camera.lookAt(sum(place, middle).map((value) => value / 2), 1.8 * far);
    if (vehicle && !this.aimed) {
      const [x, y] = turned(vehicle.pose.slice(3), [1, 0, 0]);
      [camera.azimuth, this.aimed] = [Math.atan2(x, y) + ASIDE, true];
    }
  }

  /** Draw fewer points where a frame takes long, and more again where many were quick. */
  fit(took) {
    this.quick = took < QUICK ? this.quick + 1 : 0;
    if (took > (performance.now() - this.movedAt < STILL ? SLOW : SLOW_NEWS)) this.step = Math.min(FEWEST, 2 * this.step);
    else if (this.quick > STEADY) [this.step, this.quick] = [Math.max(1, this.step / 2), 0];
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    [this.canvas.width, this.canvas.height] = [width * ratio, height * ratio].map(Math.round);
    [this.camera.width, this.camera.height] = [width, height];
    this.request();
  }
}
