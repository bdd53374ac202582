// Ties by hand: what is decided, the buttons at pairs, the list, and the file for `sonarmap map --ties`.

class Decisions {
  /** At first those that the map was made with, as the next file must hold them, too. */
  constructor(content) {
    this.content = content;
    this.listeners = [];
    this.index = new Map(content.names.map((name, k) => [name, k]));
    const consecutive = { role: "sequential", kept: true, reason: "consecutive scans, kept" };
    const tried = [...content.sequential.map(([target, source]) => ({ target, source, ...consecutive })), ...content.pairs];
    this.tried = new Map(tried.map((pair) => [`${pair.target} ${pair.source}`, pair]));
    const added = content.ties.filter(({ verdict }) => verdict === "add");
    this.added = new Set(added.map(({ target, source }) => `${this.index.get(target)} ${this.index.get(source)}`));
    this.forget();
  }

  changed() {
    this.saved = false;
    for (const listener of this.listeners) listener();
  }

  /** Go back to the ties that the map was made with. */
  forget() {
    this.ties = this.content.ties.map(({ effect, ...tie }) => ({ ...tie }));
    this.changed();
    this.saved = true;
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
}

const TIE_COLUMNS = ["target", "source", "verdict", "note"];
const TRANSFORM = ["x_m", "y_m", "z_m", "roll_deg", "pitch_deg", "yaw_deg", "sigma_m", "sigma_deg"];

/** Buttons that decide about a pair; they show what is decided, wherever it was. */
function verdictButtons(decisions, pair) {
  const buttons = [decisions.inFavor(pair), "reject", null].map((verdict) =>
    button(verdict ?? "undecided", () => decisions.decide(pair, verdict)));
  const box = make("span", { class: "verdicts", role: "group", "aria-label": "Tie by hand" }, ...buttons);
  box.update = () => {
    const verdict = decisions.tieOf(pair)?.verdict ?? "undecided";
    for (const each of buttons) each.setAttribute("aria-pressed", each.textContent === verdict);
  };
  box.update();
  return box;
}

/** The ties as a file. A tie with a transform keeps it. */
function tiesFile({ ties, content }) {
  const columns = ties.some(({ transform }) => transform && Object.keys(transform).length) ? [...TIE_COLUMNS, ...TRANSFORM] : TIE_COLUMNS;
  return csvOf(`ties for sonarmap map --ties, decided in the report of: ${content.title}`, columns, ties.map((tie) => ({ ...tie, ...tie.transform })));
}

/** What is decided, a line each with a note, and the file. `choose` shows a pair in the map. */
function tieSection(content, decisions, choose) {
  const made = new Map(content.ties.map((tie) => [`${tie.target}\n${tie.source}`, tie]));
  const body = make("div");
  const line = (tie) => {
    const pair = decisions.pairOf(tie), words = `${tie.target}\u00a0– ${tie.source}`;
    const before = made.get(`${tie.target}\n${tie.source}`);
    return [
      link(words, () => choose(pair)),
      verdictButtons(decisions, pair),
      make("input", { type: "text", value: tie.note, placeholder: "why", "aria-label": `note on ${words}`, oninput: (event) => {
        tie.note = event.target.value;
        decisions.saved = false;
      } }),
      before ? before.effect || "as before" : `new; ${pair.kept ? "the map kept it" : decisions.wasTried(pair) ? "the map refused it" : "not tried"}`,
    ];
  };
  let shown = null;
  const fill = () => {
    const listed = JSON.stringify(decisions.ties.map(({ target, source }) => [target, source]));
    if (listed === shown) return; // the buttons show their verdicts themselves, and keep the focus
    shown = listed;
    body.replaceChildren(decisions.ties.length
      ? table(["scans", "verdict", "note", "in this map"], decisions.ties.map(line))
      : make("p", {}, "Nothing is decided yet."));
  };
  follow(decisions, fill);
  return [
    make("p", {}, `Where you know better than the map: accept or reject a pair here, in the list of loops or in the map, or tie two
      scans that the map did not try. Then save ties.csv, and map again with the same options and --ties ties.csv. A rejected pair
      costs no registration again.`),
    body,
    fileButtons(decisions),
  ];
}

function fileButtons(decisions) {
  const save = () => {
    make("a", { href: `data:text/csv;charset=utf-8,${encodeURIComponent(tiesFile(decisions))}`, download: "ties.csv" }).click();
    decisions.saved = true;
  };
  const buttons = make("div", { class: "buttons" },
    button("Save ties.csv", save, { class: "save" }), button("Discard new decisions", () => decisions.forget()));
  follow(decisions, () => (buttons.hidden = !decisions.ties.length));
  return buttons;
}

/** A text without halves of characters, which UTF-8 cannot say: as their numbers, as Python's backslashreplace has them. */
function wellFormed(text) {
  const half = /[\ud800-\udbff](?![\udc00-\udfff])|(?<![\ud800-\udbff])[\udc00-\udfff]/g;
  return String(text).replace(half, (unit) => `\\u${unit.charCodeAt(0).toString(16)}`);
}

function oneLine(text) {
  return wellFormed(text).replace(/[\x00-\x1f\x7f\x85\u2028\u2029]/g, " ").trim();
}

/**
 * A cell: with an apostrophe before what a spreadsheet would take for a formula, as tools/files/readers/csv_table.py has it, and in quotes
 * where it must be: some divide cells at semicolons, and a line that began with # would be a comment.
 */
function cellOf(value) {
  let text = oneLine(value ?? "");
  if (/^'*[=+\-@\uff1d\uff0b\uff0d\uff20]/.test(text) && !Number.isFinite(Number(text)))
    text = `'${text}`;
  return /[",;]|^#/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}

/** A comment in a line, a heading, and rows: {column: value} each, of which none is empty. */
function csvOf(comment, columns, rows) {
  const line = (cells) => cells.map(cellOf).join(",");
  const lines = [`# ${oneLine(comment).replace(/[,;"]/g, " ")}`, line(columns), ...rows.map((row) => line(columns.map((name) => row[name])))];
  return `${lines.join("\n")}\n`;
}
