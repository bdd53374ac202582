// The map in 3D: what is shown of it, how it follows mouse, fingers and keys, and what is picked and measured.

const STILL = 200; // after the last movement all points are drawn [ms]
const MANY = 30000; // of fewer points all are drawn while moving, too
const THIRD = 3; // of more, every third; fewer on machines that take longer than SLOW for a frame
const FEWEST = 30; // WebGL allows no wider steps
const [SLOW, QUICK] = [50, 20]; // [ms]
const TAP = 5; // a pointer that moved less than this was a click [pixels]

class View {
  /**
   * @param stage the element that holds the canvas
   * @param content of the page
   * @param tell called with what was picked: {point}, {pose}, {pair} or {distance}, or null for nothing
   */
  constructor(stage, content, tell) {
    this.stage = stage;
    this.canvas = stage.querySelector("canvas");
    this.scene = new Scene(this.canvas);
    this.content = content;
    this.tell = tell;
    this.shown = { points: true, way: true, ellipsoids: true, kept: true, refused: true };
    this.scale = 1;
    this.measuring = false;
    this.measured = [];
    this.frames = 0;
    this.movedAt = -Infinity;
    this.moved = false; // since the last frame
    this.step = THIRD;
    new ResizeObserver(() => this.resize()).observe(stage);
    followPointer(this);
    followKeys(this);
  }

  /** Show a part of the map, whose points are unpacked. */
  showPart(part, points) {
    this.part = part;
    this.points = points;
    this.camera = new Camera(part.extent, part.middle);
    this.pairs = pairsOf(part, this.content.pairs);
    this.factor = fittingFactor(part.way, this.camera.reach);
    this.colorings = coloringsOf(part, points, this.content);
    this.scene.showPoints(points, part.voxel);
    this.colorBy(this.coloring in this.colorings ? this.coloring : "depth");
    this.measured = [];
    this.heights = [-Infinity, Infinity]; // of the points that are shown [m]
    this.showLayers();
    this.choose(null);
    this.resize();
  }

  colorBy(name) {
    const { color, palette } = this.colorings[(this.coloring = name)];
    const { places, count } = this.points;
    for (let k = 0; k < count; k++) places[4 * k + 3] = color(k);
    this.scene.usePalette(palette);
    this.scene.upload();
    this.request();
  }

  /** Draw the lines anew, after something of `shown` or `factor` changed. */
  showLayers() {
    const { way } = this.part, { shown } = this;
    const of = (kept) => this.pairs.filter((pair) => pair.kept === kept).map((pair) => pair.ends);
    this.scene.showLines("kept", shown.kept ? of(true) : [], LINES.kept);
    this.scene.showLines("refused", shown.refused ? of(false) : [], LINES.refused);
    this.scene.showLines("ellipsoids", shown.ellipsoids ? ellipsoidPieces(way, this.factor) : [], LINES.ellipsoids);
    this.scene.showLines("way", shown.way ? wayPieces(way, this.content.surveys) : [], LINES.way);
    this.showMeasured();
    this.request();
  }

  /** Choose a pair, drawn bright; null for none. */
  choose(pair) {
    this.scene.showLines("chosen", pair ? [pair.ends] : [], LINES.chosen);
    this.request();
  }

  measure(on) {
    this.measuring = on;
    this.measured = [];
    this.canvas.classList.toggle("measuring", on);
    this.showMeasured();
    this.tell(on ? { measuring: 0 } : null);
  }

  showMeasured() {
    this.scene.showLines("measured", this.measured.length === 2 ? [this.measured] : [], this.inkOf(LINES.measured));
    this.request();
  }

  /** White on a dark ground, black on a light one. */
  inkOf(style) {
    const ink = this.ground()[0] > 0.5 ? 0 : 1;
    return { ...style, color: [ink, ink, ink] };
  }

  ground() {
    const [r, g, b] = getComputedStyle(this.stage).backgroundColor.match(/[\d.]+/g).map(Number);
    return [r / 255, g / 255, b / 255];
  }

  /** What is at a pixel of the canvas; a pose before a pair before a point, but points alone while measuring. */
  pick(x, y) {
    const { camera, part, shown } = this;
    if (!this.measuring) {
      const pose = shown.way ? placeAt(part.way.places, camera, x, y) : null;
      if (pose !== null) return { pose };
      const seen = this.pairs.filter((pair) => shown[pair.kept ? "kept" : "refused"]);
      const line = lineAt(seen.map((pair) => pair.ends), camera, x, y);
      if (line !== null) return { pair: seen[line] };
    }
    const point = shown.points ? this.pointAt(x, y) : null;
    return point === null ? null : { point, place: placeOf(this.points, point) };
  }

  pointAt(x, y) {
    return pointAt(this.points, this.camera, x, y, this.scene.edge(this.camera, this.scale), this.part.voxel, this.heights);
  }

  click(x, y) {
    const hit = this.pick(x, y);
    if (this.measuring && hit) {
      this.measured = this.measured.length === 2 ? [hit.place] : [...this.measured, hit.place];
      this.showMeasured();
      this.tell(this.measured.length === 2 ? { distance: this.measured } : { measuring: 1 });
    } else if (!this.measuring) {
      this.choose(hit?.pair ?? null);
      this.mark = hit?.place ?? null;
      this.tell(hit);
    }
    this.request();
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
    const step = moving && this.points.count > MANY ? this.stepFor(now) : 1;
    const points = this.scene.points;
    this.scene.points = this.shown.points ? points : null;
    this.scene.draw(this.camera, { ground: this.ground(), scale: this.scale, step, heights: this.heights });
    this.scene.points = points;
    this.frames++;
    [this.drawnAt, this.wasMoving] = [now, moving];
    placeLabels(this);
    if (moving) {
      clearTimeout(this.settling);
      this.settling = setTimeout(() => this.request(), STILL);
    }
  }

  /** Which points are drawn while moving: every third, or fewer if the frames before took long. */
  stepFor(now) {
    const took = now - (this.drawnAt ?? -Infinity);
    if (this.wasMoving && took > SLOW) this.step = Math.min(FEWEST, 2 * this.step);
    else if (this.wasMoving && took < QUICK) this.step = Math.max(THIRD, this.step / 2);
    return Math.floor(this.step);
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

/** Mouse, pen and fingers: one turns, Shift or the right button moves, two fingers move and zoom. */
function followPointer(view) {
  const { canvas } = view;
  const pointers = new Map();
  let travelled = 0;
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (pointers.size === 1) travelled = 0;
  });
  canvas.addEventListener("pointermove", (event) => {
    const from = pointers.get(event.pointerId);
    if (!from || !view.camera) return;
    const to = [event.offsetX, event.offsetY];
    const [dx, dy] = [to[0] - from[0], to[1] - from[1]];
    travelled += Math.hypot(dx, dy);
    if (pointers.size === 2) {
      const other = [...pointers].find(([id]) => id !== event.pointerId)[1];
      const apart = (place) => Math.hypot(place[0] - other[0], place[1] - other[1]) || 1;
      view.camera.pan(dx / 2, dy / 2);
      view.camera.zoom(apart(to) / apart(from), (to[0] + other[0]) / 2, (to[1] + other[1]) / 2);
    } else if (event.shiftKey || event.buttons & 6) view.camera.pan(dx, dy);
    else view.camera.turn(0.007 * dx, 0.007 * dy);
    pointers.set(event.pointerId, to);
    view.request(true);
  });
  const lift = (event) => {
    if (pointers.delete(event.pointerId) && event.type === "pointerup" && travelled < TAP && event.button === 0 && view.camera)
      view.click(event.offsetX, event.offsetY);
  };
  canvas.addEventListener("pointerup", lift);
  canvas.addEventListener("pointercancel", lift);
  canvas.addEventListener("wheel", (event) => {
    if (!view.camera) return;
    event.preventDefault();
    view.camera.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), event.offsetX, event.offsetY);
    view.request(true);
  }, { passive: false });
}

function followKeys(view) {
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  view.canvas.addEventListener("keydown", (event) => {
    const { camera } = view;
    if (!camera || event.ctrlKey || event.metaKey || event.altKey) return;
    const arrow = arrows[event.key];
    if (arrow && event.shiftKey) camera.pan(-40 * arrow[0], -40 * arrow[1]);
    else if (arrow) camera.turn(0.08 * arrow[0], 0.08 * arrow[1]);
    else if (event.key === "+" || event.key === "=") camera.zoom(1.2);
    else if (event.key === "-") camera.zoom(1 / 1.2);
    else if (event.key === "Home") camera.reset();
    else if (event.key === "t" || event.key === "T") camera.fromAbove();
    else if (event.key === "m" || event.key === "M") view.measure(!view.measuring);
    else if (event.key === "Escape") view.measure(false);
    else return;
    event.preventDefault();
    view.request(true);
  });
}
