// What the report and the live page share: a scene under a camera. While something changes, a frame draws as many points and
// pixels as it has time for; once nothing does, the rest of them is drawn over some frames, and then nothing more.

const [SLOW, QUICK] = [36, 20]; // frames [ms] after which fewer points are drawn, and more
const [LEAST_BUDGET, FIRST_BUDGET, MOST_BUDGET] = [15, 19, 22].map((power) => 2 ** power); // points of a frame: at least, at first, at most
const PIXELS = 8; // of a frame, for each of its points
const MOST_STEP = 42; // from a point to the next: WebGL allows no wider ones
const CLOUD = 256; // points that take as long to draw as a cloud without any takes
const STILL = 400, STEADY = 30; // without a change for so long all points are drawn [ms]; quick frames before more are [frames]

class MapView {
  /** In `stage`. Its own are `part`: {axes}, null while there is nothing to draw; `look`: what a scene draws, and {labels}; and `click`. */
  constructor(stage) {
    Object.assign(this, { stage, part: null, frames: 0, budget: FIRST_BUDGET, quick: 0 });
    this.canvas = make("canvas", { id: "canvas", tabindex: 0, role: "application", "aria-label": "Map in 3D", "aria-describedby": "keys" });
    stage.prepend(this.canvas, make("svg", { id: "compass", width: 84, height: 84, viewBox: "-42 -42 84 84", "aria-hidden": "true" }),
      make("div", { id: "bar", "aria-hidden": "true" }, make("span")), make("div", { id: "labels", "aria-hidden": "true" }));
    this.scene = new Scene(this.canvas, PALETTE);
    this.camera = new Camera();
    this.heights = [-Infinity, Infinity]; // of the points that are shown [m]
    new ResizeObserver(() => this.resize()).observe(stage);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.request());
    followPointer(this);
  }

  /** Ask for a frame, as something changed. */
  request() {
    this.waiting ??= requestAnimationFrame((now) => this.draw(now));
  }

  draw(now) {
    this.waiting = null;
    clearTimeout(this.resting);
    cancelAnimationFrame(this.completing);
    if (!this.part) return;
    const { camera, heights, scene } = this, { labels, ...own } = this.look(), ratio = Math.min(2, window.devicePixelRatio || 1);
    const count = own.clouds.flatMap(({ tiles }) => tiles).reduce((points, tile) => points + tile.count, 0);
    const groups = Math.ceil((CLOUD * own.clouds.length) / this.budget) || 1;
    const slices = groups * Math.min(MOST_STEP, Math.ceil(count / this.budget / groups) || 1);
    const share = Math.min(1, Math.sqrt((PIXELS * this.budget) / (camera.width * camera.height * ratio ** 2)));
    const look = { ground: this.ground(), heights, groups, slices, ratio, ...own }, fast = { ...look, alone: true, ratio: share * ratio };
    scene.gather(camera, fast, 0);
    scene.show(camera, fast);
    putLabels(this, labels);
    [this.frames, this.drawn] = [this.frames + 1, now];
    if (slices > 1 || share < 1) this.resting = setTimeout(() => this.complete(look, 0), STILL);
    requestAnimationFrame((next) => (this.waiting || this.drawn === next) && this.fit(next - now)); // of a movement
  }

  /** Draw all points, a slice a frame, until something changes; the last one shows them. */
  complete(look, slice) {
    if (this.waiting) return;
    this.scene.gather(this.camera, look, slice);
    if (slice + 1 < look.slices) this.completing = requestAnimationFrame(() => this.complete(look, slice + 1));
    else this.scene.show(this.camera, look);
  }

  /** Draw fewer points where a frame takes long, and more again where many were quick. */
  fit(took) {
    this.quick = took < QUICK ? this.quick + 1 : 0;
    if (took > SLOW) this.budget = Math.max(LEAST_BUDGET, this.budget / 2);
    else if (this.quick > STEADY) [this.budget, this.quick] = [Math.min(MOST_BUDGET, 2 * this.budget), 0];
  }

  ground() {
    return getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g).slice(0, 3).map((value) => value / 255);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!width || !height) return;
    [this.camera.width, this.camera.height] = [width, height];
    this.request();
  }
}
