// What was received of the dive; the twin of messages.py. Nothing here draws.

const SAMPLES = 64; // points of a cloud that its extent and the colors are taken from
const STEPS = 20000; // samples of all clouds at most

class Dive {
  constructor() {
    this.state = { status: "waiting", sentence: "Waiting for the first scan.", alerts: [] };
    this.poses = []; // of key scans: {part, place [m], turn: quaternion x, y, z, w}
    this.clouds = new Map(); // {key scan: {key, quantum [m], places: Int16Array of x, y, z [quanta], count}}
    this.track = []; // [key scan, x, y, z]
    this.loops = [];
    this.coverage = new Map(); // {part: {width, height, cell [m], corner [m], counts}}
    this.last = null; // the last scan, as a cloud
  }

  /** Take a message in; what it changed: its kind, and of a cloud the cloud. */
  take(message) {
    if (typeof message !== "string") return this.takeBytes(message);
    const content = JSON.parse(message);
    if (content.kind === "reset") Object.assign(this, new Dive());
    else if (content.kind === "state") this.state = content;
    else if (content.kind === "loops") this.loops = content.pairs;
    else if (content.kind === "poses")
      content.poses.forEach(([part, x, y, z, ...turn], k) => (this.poses[content.first + k] = { part, place: [x, y, z], turn }));
    else if (content.kind === "track") {
      this.track.length = Math.min(this.track.length, content.first ?? this.track.length); // thinned, it begins anew
      for (const point of content.points) this.track.push(point);
    }
    return { kind: content.kind };
  }

  takeBytes(buffer) {
    const head = new DataView(buffer);
    const kind = ["", "cloud", "last", "coverage"][head.getUint8(0)];
    if (kind === "coverage") {
      const [width, height, part] = [4, 8, 24].map((at) => head.getUint32(at, true));
      const [cell, x, y] = [12, 16, 20].map((at) => head.getFloat32(at, true));
      this.coverage.set(part, { width, height, cell, corner: [x, y], counts: new Uint8Array(buffer, 28) });
      return { kind };
    }
    const places = new Int16Array(buffer, 12); // every machine with a browser is little-endian
    const cloud = { key: head.getUint32(4, true), quantum: head.getFloat32(8, true), places, count: places.length / 3 };
    if (kind === "cloud") this.clouds.set(cloud.key, cloud);
    else this.last = cloud;
    return { kind, cloud };
  }

  /** A place in a key scan's frame [m], in the frame of its part; null while its pose is not known. */
  placed(key, place) {
    const pose = this.poses[key];
    return pose ? sum(turned(pose.turn, place), pose.place) : null;
  }

  /** Whether a key scan's pose is known, in this part. */
  isIn(part, key) {
    return this.poses[key]?.part === part;
  }

  /** Points of this part, about evenly chosen, in its frame [m]. */
  samples(part) {
    const clouds = [...this.clouds.values()].filter(({ key }) => this.isIn(part, key));
    const each = Math.max(4, Math.min(SAMPLES, Math.floor(STEPS / (clouds.length || 1))));
    return clouds.flatMap(({ key, quantum, places, count }) => Array.from({ length: Math.min(each, count) }, (_, k) => {
      const at = 3 * Math.floor((k * count) / Math.min(each, count));
      return this.placed(key, [0, 1, 2].map((axis) => quantum * places[at + axis]));
    }));
  }

  /** Lines along the track of this part, at most so many. */
  trackPieces(part, most) {
    const step = Math.ceil(this.track.length / most);
    const shown = this.track.filter((_, k) => k % step === 0 || k === this.track.length - 1);
    const places = shown.map(([key, ...place]) => (this.isIn(part, key) ? this.placed(key, place) : null));
    return places.slice(1).map((place, k) => [places[k], place]).filter(([from, to]) => from && to);
  }

  loopPieces(part) {
    return this.loops.filter((pair) => pair.every((key) => this.isIn(part, key))).map((pair) => pair.map((key) => this.poses[key].place));
  }
}

/** Half axes of an ellipsoid of a covariance [m^2]: a square root of it by Cholesky's way, whose columns span the same ellipsoid. */
function halfAxes(covariance) {
  const L = [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  for (let i = 0; i < 3; i++)
    for (let j = 0; j <= i; j++) {
      const rest = covariance[i][j] - dot(L[i], L[j]);
      L[i][j] = i === j ? Math.sqrt(Math.max(rest, 0)) : L[j][j] > 0 ? rest / L[j][j] : 0;
    }
  return [0, 1, 2].map((axis) => L.map((row) => row[axis]));
}
