// The map in 3D: what is shown of it, and what is picked and measured. It is drawn when something changed, and with fewer
// points while it moves.

const STILL = 200; // after the last movement all points are drawn [ms]
const MANY = 30000; // of fewer points all are drawn while moving, too
const THIRD = 3; // of more, every third; fewer on machines that take longer than SLOW for a frame
const FEWEST = 30; // WebGL allows no wider steps
const [SLOW, QUICK] = [50, 20]; // [ms]
const ARM = 0.012; // of a control point's cross, as a share of the map's reach

class View {
  /** `tell` is called with what was picked: {point}, {pose}, {pair}, {distance} or {tying}, or null. */
  constructor(stage, content, decisions, tell) {
    Object.assign(this, { stage, content, decisions, tell });
    this.canvas = stage.querySelector("canvas");
    this.scene = new Scene(this.canvas);
    this.heights = [-Infinity, Infinity]; // of the points that are shown [m]
    this.frames = 0;
    this.movedAt = -Infinity;
    this.moved = false; // since the last frame
    this.step = THIRD;
    this.shown = { points: true, track: true, before: false, ellipsoids: true, kept: true, refused: true, decided: true, control: true, wrong: true };
    this.measuring = false;
    this.tying = null; // the scan that the next pose is tied to
    this.measured = [];
    new ResizeObserver(() => this.resize()).observe(stage);
    followPointer(this);
    followKeys(this, { m: () => this.measure(!this.measuring), Escape: () => this.leave() });
  }

  /** Show a part of the map, whose points are unpacked. */
  showPart(part, points) {
    this.part = part;
    this.points = points;
    this.camera = new Camera(part.extent, part.middle);
    this.resize();
    this.camera.reset(); // as the picture is high and wide now
    this.pairs = pairsOf(part, this.content.pairs);
    this.control = controlOf(part, this.content);
    this.wrong = wrongPieces(part.track, this.content.wrong_fixes);
    this.factor = fittingFactor(part.track, this.camera.reach);
    this.exaggeration = fittingExaggeration(this.control, this.camera.reach);
    this.colorings = coloringsOf(part, points);
    this.scene.showPoints("points", points);
    this.colorBy(this.coloring in this.colorings ? this.coloring : "depth");
    this.measured = [];
    this.mark = null;
    this.heights = [-Infinity, Infinity];
    this.choose(null);
    this.showLayers();
  }

  colorBy(name) {
    const { color, palette } = this.colorings[(this.coloring = name)];
    const { places, count } = this.points;
    for (let k = 0; k < count; k++) places[4 * k + 3] = color(k);
    this.scene.usePalette(palette);
    this.scene.upload("points");
    this.request();
  }

  /** Draw the lines anew, after something of `shown`, of the factors, or of the decisions changed. */
  showLayers() {
    const { track } = this.part, { shown, control } = this;
    const lines = (name, on, pieces, style = LINES[name]) => this.scene.showLines(name, on ? pieces() : [], style);
    this.ties = decidedPairs(this.part, this.decisions);
    for (const name of ["kept", "refused"])
      lines(name, shown[name], () => this.pairs.filter((pair) => pair.kept === (name === "kept")).map((pair) => pair.ends));
    lines("ellipsoids", shown.ellipsoids, () => ellipsoidPieces(track, this.factor));
    lines("before", shown.before && track.before, () => trackPieces(track, this.content.surveys, track.before));
    lines("track", shown.track, () => trackPieces(track, this.content.surveys));
    for (const name of ["accepted", "rejected"])
      lines(name, shown.decided, () => this.ties.filter((tie) => (tie.verdict === "reject") === (name === "rejected")).map((tie) => tie.ends));
    lines("control", shown.control, () => crosses(control.map(({ known }) => known), ARM * this.camera.reach));
    lines("residuals", shown.control, () => residualPieces(control, this.exaggeration));
    lines("wrong", shown.wrong, () => [...this.wrong, ...crosses(this.wrong.map(([, place]) => place), ARM * this.camera.reach)]);
    this.showMeasured();
    this.request();
  }

  /** Choose a pair, drawn bright; null for none. */
  choose(pair) {
    this.scene.showLines("chosen", pair ? [pair.ends] : [], LINES.chosen);
    this.request();
  }

  /** Have the user pick two points (`measuring`), the pose that is tied to the scan `tying`, or what there is. */
  ask(measuring, tying, message) {
    [this.measuring, this.tying, this.measured] = [measuring, tying, []];
    this.canvas.classList.toggle("measuring", measuring || tying !== null);
    this.showMeasured();
    this.tell(message);
  }

  measure(on) {
    this.ask(on, null, on ? { measuring: 0 } : null);
  }

  /** End what is being measured or tied, and choose nothing. */
  leave() {
    this.measure(false);
    this.choose(null);
    this.mark = null;
  }

  /** Have the user pick the pose that is tied to this scan; null ends it. */
  tie(scan) {
    this.ask(false, scan, scan === null ? null : { tying: scan });
  }

  showMeasured() {
    const ink = this.ground()[0] > 0.5 ? 0 : 1; // white on a dark ground, black on a light one
    this.scene.showLines("measured", this.measured.length === 2 ? [this.measured] : [], { ...LINES.measured, color: [ink, ink, ink] });
    this.request();
  }

  /** What is at a pixel: a pose before a pair before a point, but points alone while measuring and poses alone while tying. */
  pick(x, y, near = NEAR) {
    const { camera, part, shown } = this;
    if (this.tying !== null) {
      const pose = placeAt(part.track.places, camera, x, y, 2 * near);
      return pose === null ? null : { pose };
    }
    if (!this.measuring) {
      const pose = shown.track ? placeAt(part.track.places, camera, x, y, near) : null;
      if (pose !== null) return { pose };
      const seen = [...(shown.decided ? this.ties : []), ...this.pairs.filter((pair) => shown[pair.kept ? "kept" : "refused"])];
      const line = lineAt(seen.map((pair) => pair.ends), camera, x, y, near / 2);
      if (line !== null) return { pair: seen[line] };
    }
    const { voxel } = part, edge = this.scene.edge(camera, voxel);
    const point = shown.points ? pointAt(this.points, camera, x, y, edge, voxel, this.heights) : null;
    return point === null ? null : { point, place: placeOf(this.points, point) };
  }

  click(x, y, near) {
    const hit = this.pick(x, y, near);
    if (this.tying !== null) {
      if (hit) this.tieTo(this.part.track.scans[hit.pose]);
    } else if (this.measuring && hit) {
      this.measured = this.measured.length === 2 ? [hit.place] : [...this.measured, hit.place];
      this.showMeasured();
      this.tell(this.measured.length === 2 ? { distance: this.measured } : { measuring: 1 });
    } else if (!this.measuring) {
      this.choose(hit?.pair ?? null);
      this.mark = hit?.place ?? (hit && "pose" in hit ? this.part.track.places[hit.pose] : null);
      this.tell(hit);
    }
    this.request();
  }

  /** Choose the pair of the scan that is being tied and another. */
  tieTo(scan) {
    if (scan === this.tying) return;
    const pair = this.decisions.pairOf(this.decisions.between(this.tying, scan));
    this.tie(null);
    this.mark = null;
    const [drawn] = pairsOf(this.part, [pair]);
    this.choose(drawn ?? null);
    this.tell({ pair: drawn ?? pair });
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
    const clouds = this.shown.points ? ["points"] : [], { scene, heights } = this;
    const step = moving && this.points.count > MANY ? this.stepFor(now) : 1;
    scene.draw(this.camera, { ground: this.ground(), clouds, voxel: this.part.voxel, step, heights });
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
