// What the report and the live page share: a scene under a camera. It is drawn when something changed, and with fewer points
// where a frame takes long.

const [SLOW, QUICK] = [80, 20]; // frames [ms] after which fewer points are drawn, and more
const FEWEST = 32; // every how many points a slow machine draws at most: WebGL allows no wider steps
const STILL = 1000, STEADY = 30; // without a change for so long all points are drawn [ms]; quick frames before more are [frames]

class MapView {
  /** In `stage`. Its own are `part`: {axes}, null while there is nothing to draw; `look`: what a scene draws, and {labels}; and `click`. */
  constructor(stage) {
    Object.assign(this, { stage, part: null, frames: 0, step: 1, quick: 0 });
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

  request() {
    this.waiting ??= requestAnimationFrame((now) => this.draw(now));
  }

  draw(now) {
    this.waiting = null;
    if (!this.part) return;
    clearTimeout(this.resting);
    const { camera, heights, scene } = this, step = this.still ? 1 : this.step;
    this.still = false;
    if (step > 1) this.resting = setTimeout(() => ((this.still = true), this.request()), STILL);
    const look = this.look();
    scene.draw(camera, { ground: this.ground(), heights, step, ...look });
    putLabels(this, look.labels);
    this.frames++;
    if (step === this.step) requestAnimationFrame((next) => this.fit(next - now)); // which comes when this one is drawn
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
