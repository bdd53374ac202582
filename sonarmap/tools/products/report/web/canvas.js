// A canvas with a scene and a camera, which mouse, fingers and keys move: drawn when something changed, and with fewer
// points while it moves.

const STILL = 200; // after the last movement all points are drawn [ms]
const MANY = 30000; // of fewer points all are drawn while moving, too
const THIRD = 3; // of more, every third; fewer on machines that take longer than SLOW for a frame
const FEWEST = 30; // WebGL allows no wider steps
const [SLOW, QUICK] = [50, 20]; // [ms]
const FLIGHT = 600; // [ms]

/**
 * What extends this has a `camera` once there is something to see, a `part` with {voxel, axes}, and clouds(),
 * label() and click(x, y, near).
 */
class CanvasView {
  constructor(stage, scene = Scene) {
    this.stage = stage;
    this.canvas = stage.querySelector("canvas");
    this.scene = new scene(this.canvas);
    this.scale = 1; // of the points
    this.heights = [-Infinity, Infinity]; // of the points that are shown [m]
    this.frames = 0;
    this.movedAt = -Infinity;
    this.moved = false; // since the last frame
    this.step = THIRD;
    new ResizeObserver(() => this.resize()).observe(stage);
    followPointer(this);
  }

  /** Ask for a frame; `moving` if a third of the points will do. */
  request(moving = false) {
    if (moving) [this.movedAt, this.moved] = [performance.now(), true];
    this.waiting ??= requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.waiting = null;
    if (!this.camera) return;
    const now = performance.now();
    const moving = this.moved || now - this.movedAt < STILL; // a slow machine draws long after it was asked
    this.moved = false;
    const clouds = this.clouds(), { scale, scene, heights } = this;
    const count = clouds.reduce((all, name) => all + (scene.clouds.get(name)?.points.count ?? 0), 0);
    const step = moving && count > MANY ? this.stepFor(now) : 1;
    scene.draw(this.camera, { ground: this.ground(), clouds, voxel: this.part.voxel, scale, step, heights });
    this.frames++;
    [this.drawnAt, this.wasMoving] = [now, moving];
    this.label();
    if (moving) {
      clearTimeout(this.settling);
      this.settling = setTimeout(() => this.request(), STILL);
    }
  }

  /** Look at a place from this distance [m], in a flight that a movement by the user ends. */
  fly(place, near) {
    const { camera } = this, { target: from, distance: far } = camera, begin = performance.now();
    const lasts = matchMedia("(prefers-reduced-motion: reduce)").matches ? 1 : FLIGHT;
    let last = from;
    const step = (now) => {
      if (camera.target !== last) return; // as the user moved it, or another flight began
      const time = Math.max(0, Math.min(1, (now - begin) / lasts)), share = time * time * (3 - 2 * time);
      camera.lookAt(sum(from, minus(place, from), share), far * (near / far) ** share);
      last = camera.target;
      this.request(true);
      if (time < 1) requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** Which points are drawn while moving: every third, or fewer if the frames before took long. */
  stepFor(now) {
    const took = now - (this.drawnAt ?? -Infinity);
    if (this.wasMoving && took > SLOW) this.step = Math.min(FEWEST, 2 * this.step);
    else if (this.wasMoving && took < QUICK) this.step = Math.max(THIRD, this.step / 2);
    return Math.floor(this.step);
  }

  ground() {
    const [r, g, b] = getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g).map(Number);
    return [r / 255, g / 255, b / 255];
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.stage;
    if (!this.camera || !width || !height) return;
    const ratio = Math.min(2, window.devicePixelRatio || 1);
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    [this.camera.width, this.camera.height] = [width, height];
    this.request();
  }
}
