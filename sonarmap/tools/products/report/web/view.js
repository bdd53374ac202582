// The map in 3D: what is shown of it, and what is picked and measured.

const ARM = 0.012; // of a control point's cross, as a share of the map's reach
const MOST_LABELS = 60; // of control points

class ReportView extends MapView {
  /** `tell` is called with what was picked: {point}, {pose}, {pair}, {distance} or {tying}, or null. */
  constructor(stage, content, decisions, tell) {
    super(stage);
    Object.assign(this, { content, decisions, tell });
    this.shown = { points: true, track: true, ellipsoids: true, kept: true, refused: true, decided: true, control: true };
    this.measuring = false;
    this.tying = null; // the scan that the next pose is tied to
    this.measured = [];
    followKeys(this, { m: () => this.measure(!this.measuring), Escape: () => this.leave() });
  }

  /** Show a part of the map, whose points are unpacked. */
  showPart(part, points) {
    this.part = part;
    this.points = points;
    this.camera.cover(part.extent, part.middle);
    this.resize();
    this.camera.reset(); // as the picture is high and wide now
    this.pairs = pairsOf(part, this.content.pairs);
    this.control = controlOf(part, this.content);
    const { reach } = this.camera, [typical] = quantiles(part.track.half_axes.map((axes) => CONFIDENCE * Math.max(...axes.map(lengthOf))), 0.5);
    this.factor = enlargement(typical, 0.012 * reach);
    this.exaggeration = enlargement(Math.max(0, ...this.control.map(({ row }) => lengthOf(row.residual))), 0.1 * reach);
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
    const { texel } = this.colorings[(this.coloring = name)];
    this.scene.colorPoints("points", texel && Uint8Array.from({ length: this.points.count }, (_, k) => texel(k)));
    this.request();
  }

  /** Draw the lines anew, after something of `shown`, of the factors, or of the decisions changed. */
  showLayers() {
    const { track } = this.part, { shown, control } = this;
    this.ties = decidedPairs(this.part, this.decisions);
    const lines = (name, on, pieces) => this.scene.showLines(name, on ? pieces : [], LINES[name]);
    const ends = (pairs, of) => pairs.filter(of).map((pair) => pair.ends);
    lines("kept", shown.kept, ends(this.pairs, ({ kept }) => kept));
    lines("refused", shown.refused, ends(this.pairs, ({ kept }) => !kept));
    lines("ellipsoids", shown.ellipsoids, ellipsoidPieces(track, this.factor));
    lines("track", shown.track, trackPieces(track, this.content.surveys));
    lines("accepted", shown.decided, ends(this.ties, ({ verdict }) => verdict !== "reject"));
    lines("rejected", shown.decided, ends(this.ties, ({ verdict }) => verdict === "reject"));
    lines("control", shown.control, crosses(control.map(({ known }) => known), ARM * this.camera.reach));
    lines("residuals", shown.control, residualPieces(control, this.exaggeration));
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
    this.scene.showLines("measured", this.measured.length === 2 ? [this.measured] : [], LINES.measured);
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

  look() {
    const { part, points, shown } = this;
    const clouds = shown.points ? [{ name: "points", tiles: points.tiles }] : [];
    return { clouds, voxel: part.voxel, range: part.height.range, labels: this.labels() };
  }

  /** Names of places: [[place, text], ...]. */
  labels() {
    const { control, mark, measured, measuring, part: { track: { places } }, shown } = this;
    return [
      ...(shown.track && places.length > 1 ? [[places[0], "start"], [places[places.length - 1], "end"]] : []),
      ...(shown.control ? control.map(({ name, known }) => [known, `△ ${name}`]).slice(0, MOST_LABELS) : []),
      ...measured.map((place, k) => [place, "AB"[k]]),
      ...(mark && !measuring ? [[mark, "◉"]] : []),
    ];
  }
}
