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

// Every key scan's cloud in its own frame: when a loop closes, its pose changes, a uniform, and no point.

const CLOUD_VERTEX = `#version 300 es
in vec3 place;              // [quanta], in the sensor's frame of the key scan
uniform mat4 clip_from_target;
uniform vec4 turn;          // of the key scan, a quaternion x, y, z, w
uniform vec3 offset;        // of the key scan, less the target [m]
uniform float quantum;      // [m]
uniform float edge;         // of a point at a distance of 1 m [pixels of the card]
uniform vec2 sizes;         // smallest and largest edge [pixels of the card]
uniform vec2 heights;       // at the ends of the palette, less the target's [m]
uniform float texel;        // of all points; below zero for each its height's
uniform sampler2D palette;
out vec3 color;
void main() {
  vec3 own = quantum * place;
  vec3 at = own + 2.0 * cross(turn.xyz, cross(turn.xyz, own) + turn.w * own) + offset;
  gl_Position = clip_from_target * vec4(at, 1.0);
  gl_PointSize = clamp(edge / gl_Position.w, sizes.x, sizes.y);
  float share = clamp((at.z - heights.x) / max(heights.y - heights.x, 1e-6), 0.0, 1.0);
  color = texelFetch(palette, ivec2(int(texel < 0.0 ? 254.0 * share + 0.5 : texel), 0), 0).rgb;
}`;
const LAST_TEXEL = 256, LAST_COLOR = [255, 64, 176]; // behind the palette, of the last scan
const GROWTH = 0.3; // of points of which fewer are drawn: by 0.5 they would cover as much
const POINT_BYTES = 6; // x, y and z, two each

class CloudScene extends Scene {
  constructor(canvas) {
    super(canvas);
    this.cloudProgram = this.program(CLOUD_VERTEX, POINT_FRAGMENT);
    this.at = this.gl.getAttribLocation(this.cloudProgram.program, "place");
  }

  forget() {
    for (const { buffer } of this.clouds.values()) this.gl.deleteBuffer(buffer);
    this.clouds.clear();
  }

  /** `look` as the report's, with {poses, range: heights at the ends of the palette [m]}; the cloud "last" is drawn larger. */
  drawClouds(camera, matrix, look, ratio) {
    const { gl, at } = this, { uniforms, program } = this.cloudProgram;
    gl.useProgram(program);
    gl.uniformMatrix4fv(uniforms.clip_from_target, false, matrix);
    gl.uniform2f(uniforms.heights, ...look.range.map((height) => height - camera.target[2]));
    gl.bindTexture(gl.TEXTURE_2D, this.palette);
    for (const name of look.clouds) {
      const { points, buffer, array } = this.clouds.get(name), pose = look.poses[points.key];
      const [step, larger, texel] = name === "last" ? [1, 1.4, LAST_TEXEL] : [look.step, 1, -1];
      gl.uniform1f(uniforms.edge, this.edge(camera, larger * look.voxel) * ratio * step ** GROWTH);
      gl.uniform2f(uniforms.sizes, ...SQUARES.map((size) => larger * size * ratio));
      gl.uniform4fv(uniforms.turn, pose.turn);
      gl.uniform3fv(uniforms.offset, minus(pose.place, camera.target));
      gl.uniform1f(uniforms.quantum, points.quantum);
      gl.uniform1f(uniforms.texel, texel);
      gl.bindVertexArray(array);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, 3, gl.SHORT, false, POINT_BYTES * step, 0);
      gl.drawArrays(gl.POINTS, 0, Math.ceil(points.count / step));
    }
    gl.bindVertexArray(null);
  }
}

// The dive in 3D: the map of a part, the vehicle in it, and the camera that follows it until the user moves it.

const STATUS_COLORS = { placed: [0, 0.62, 0.45], uncertain: [0.9, 0.62, 0], lost: [0.9, 0.1, 0.1] };
const UNKNOWN_COLOR = [0.55, 0.55, 0.55]; // of a vehicle that waits, or whose dive has ended
const ARROW = 30; // half its length [pixels]
const REFRESH = 300; // between two looks at all points and lines [ms]
const ASIDE = 0.5; // of the vehicle's heading, so that the arrow hides less [rad]
const [SLOW, QUICK] = [80, 20]; // frames [ms] after which fewer points are drawn, and more
const FEWEST = 32; // every how many points a slow machine draws at most: WebGL allows no wider steps
const STILL = 1000, STEADY = 30; // without news for so long all points are drawn [ms]; quick frames before more are [frames]

class LiveView {
  constructor(stage, dive) {
    Object.assign(this, { stage, dive, follow: true, chosen: null, frames: 0, step: 1, quick: 0, span: 5 });
    this.canvas = stage.querySelector("canvas");
    this.scene = new CloudScene(this.canvas);
    this.part = { number: 0, axes: ["x", "y", "z"] };
    this.range = [0, 1]; // heights at the ends of the palette [m]
    this.camera = new Camera([[-5, -5, -5], [5, 5, 5]], [[-5, -5, -5], [5, 5, 5]]);
    this.colorings = { height: { palette: ramp("viridis"), label: "height in the frame of this map" } };
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
    const [low, high] = this.range;
    this.colorings.height.marks = [0, 0.5, 1].map((share) => [254 * share, meters(low + share * (high - low), 0.1)]);
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
    this.waiting ??= requestAnimationFrame((now) => this.draw(now));
  }

  draw(now) {
    this.waiting = null;
    clearTimeout(this.resting);
    const { camera, dive, scene } = this, step = this.still ? 1 : this.step;
    this.still = false;
    if (step > 1) this.resting = setTimeout(() => ((this.still = true), this.request()), STILL);
    if (this.follow) this.followVehicle();
    const clouds = [...scene.clouds].filter(([, { points }]) => dive.isIn(this.part.number, points.key)).map(([name]) => name);
    const labels = this.showVehicle();
    scene.draw(camera, { ground: this.ground(), clouds, voxel: 0.003 * this.span, step, poses: dive.poses, range: this.range });
    putLabels(this, labels);
    this.frames++;
    if (step === this.step) requestAnimationFrame((next) => this.fit(next - now)); // which comes when this one is drawn
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

  /** Draw fewer points where a frame takes long, and more again where many were quick. */
  fit(took) {
    this.quick = took < QUICK ? this.quick + 1 : 0;
    if (took > SLOW) this.step = Math.min(FEWEST, 2 * this.step);
    else if (this.quick > STEADY) [this.step, this.quick] = [Math.max(1, this.step / 2), 0];
  }

  ground() {
    return getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g).slice(0, 3).map((value) => value / 255);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage, ratio = Math.min(2, window.devicePixelRatio || 1);
    if (!width || !height) return;
    [this.canvas.width, this.canvas.height] = [width * ratio, height * ratio].map(Math.round);
    [this.camera.width, this.camera.height] = [width, height];
    this.request();
  }
}
