// What the user decides: ties between scans, and control points. The browser keeps it, where it keeps anything for pages on disk.

const POINT_DIGITS = 4; // behind the point, of a control point's coordinates [m]
const SIGMA = 0.05; // of a control point that the user names, until the user says better [m]

const areTexts = (values) => values.every((value) => typeof value === "string");
const isTie = ({ target, source, verdict, note }) => areTexts([target, source, verdict, note]);
const isControl = ({ name, scan, point, known, sigma, sigma_up, use }) =>
  areTexts([name, scan, ...known, sigma, sigma_up, use]) && point.every(Number.isFinite);

class Decisions {
  /** Those that the browser kept for this map; else those that the map was made with, as the next file must hold them, too. */
  constructor(content) {
    this.content = content;
    this.key = `sonarmap ${content.key}`;
    this.listeners = [];
    this.lost = false; // whether the browser keeps nothing
    this.index = new Map(content.names.map((name, k) => [name, k]));
    const consecutive = { role: "sequential", kept: true, reason: "consecutive scans, kept" };
    const tried = [...content.sequential.map(([target, source]) => ({ target, source, ...consecutive })), ...content.pairs];
    this.tried = new Map(tried.map((pair) => [`${pair.target} ${pair.source}`, pair]));
    const added = content.ties.filter(({ verdict }) => verdict === "add");
    this.added = new Set(added.map(({ target, source }) => `${this.index.get(target)} ${this.index.get(source)}`));
    ({ ties: this.ties, control: this.control } = this.kept() ?? { ties: this.asMade("ties"), control: this.asMade("control") });
  }

  /** The ties or control points that the map was made with. */
  asMade(kind) {
    if (kind === "ties") return this.content.ties.map(({ effect, ...tie }) => ({ ...tie }));
    return this.content.control_points.map(({ name, scan, point, known, sigma, use }) => (
      { name, scan, point, known: known.map((value) => String(Number(value.toFixed(POINT_DIGITS)))), sigma: String(sigma[0]), sigma_up: sigma[2] === sigma[0] ? "" : String(sigma[2]), use }));
  }

  kept() {
    try {
      const { ties, control } = JSON.parse(localStorage.getItem(this.key));
      return ties.every(isTie) && control.every(isControl) ? { ties, control } : null;
    } catch {
      return null; // nothing is there, or nothing may be read
    }
  }

  /** Have the browser keep the decisions. */
  keep() {
    try {
      localStorage.setItem(this.key, JSON.stringify({ ties: this.ties, control: this.control }));
    } catch {
      this.lost = true;
    }
  }

  changed() {
    this.keep();
    for (const listener of this.listeners) listener();
  }

  forget(kind) {
    this[kind] = this.asMade(kind);
    this.changed();
  }

  /** The tie of a pair, by the numbers of its scans; undefined where the user decided nothing. */
  tieOf({ target, source }) {
    const { names } = this.content;
    return this.ties.find((tie) => tie.target === names[target] && tie.source === names[source]);
  }

  /** Decide about a pair: accept, reject, add, or null for undecided. */
  decide(pair, verdict) {
    const tie = this.tieOf(pair);
    const { names } = this.content;
    if (!verdict) this.ties = this.ties.filter((other) => other !== tie);
    else if (!tie) this.ties.push({ target: names[pair.target], source: names[pair.source], verdict, note: "" });
    else {
      tie.verdict = verdict;
      if (verdict !== "add") delete tie.transform;
    }
    this.changed();
  }

  remove(kind, one) {
    this[kind] = this[kind].filter((other) => other !== one);
    this.changed();
  }

  /** What a tie between two scans would join, the earlier as the target. */
  between(one, other) {
    const { names } = this.content;
    return { target: names[Math.min(one, other)], source: names[Math.max(one, other)] };
  }

  /** The pair of a tie: as it was tried, or new. */
  pairOf({ target, source }) {
    const [i, j] = [this.index.get(target), this.index.get(source)];
    return this.tried.get(`${i} ${j}`) ?? { target: i, source: j, role: "new", kept: false, reason: "not tried by the map" };
  }

  wasTried = ({ target, source }) => this.tried.has(`${target} ${source}`);

  /** The verdict for a pair: "add" where no search of the map proposed it, as "accept" counts only for pairs that are tried. */
  inFavor(pair) {
    return this.wasTried(pair) && !this.added.has(`${pair.target} ${pair.source}`) ? "accept" : "add";
  }

  /** Name a point [m] of a scan's sensor frame as a control point, whose known place the user fills in. */
  nameControl(scan, point) {
    let number = 1;
    while (this.control.some(({ name }) => name === `point ${number}`)) number++;
    const named = { name: `point ${number}`, scan, point: point.map((value) => Number(value.toFixed(POINT_DIGITS))), known: ["", "", ""], sigma: String(SIGMA), sigma_up: "", use: "control" };
    this.control.push(named);
    this.changed();
    return named;
  }
}
