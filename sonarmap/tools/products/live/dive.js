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
