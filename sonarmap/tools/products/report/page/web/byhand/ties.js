// Ties by hand: buttons at pairs, the list of what is decided, and the file of it.

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

/** What is decided, a line each with a note; ties by name; and the file. `choose` shows a pair in the map. */
function tieSection(content, decisions, choose) {
  const made = new Map(content.ties.map((tie) => [`${tie.target}\n${tie.source}`, tie]));
  const body = make("div");
  const line = (tie) => {
    const pair = decisions.pairOf(tie), words = `${tie.target}\u00a0– ${tie.source}`;
    const known = pair.target !== undefined && pair.source !== undefined;
    const before = made.get(`${tie.target}\n${tie.source}`);
    return [
      known ? link(words, () => choose(pair)) : `${words} (no scans of this map)`,
      known ? verdictButtons(decisions, pair) : button("remove", () => decisions.remove("ties", tie)),
      make("input", { type: "text", value: tie.note, placeholder: "why", "aria-label": `note on ${words}`, oninput: (event) => {
        tie.note = event.target.value;
        decisions.keep();
      } }),
      before ? before.effect || "as before" : known ? `new; ${pair.kept ? "the map kept it" : decisions.wasTried(pair) ? "the map refused it" : "not tried"}` : "",
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
      scans that the map did not try. Then save ties.csv and map again. A rejected pair costs no registration again.`),
    body,
    nameForm(content, decisions, choose),
    ...fileButtons(decisions, "ties", () => tiesFile(decisions)),
    commandBox(decisions),
  ];
}

/** Two scans by their names. */
function nameForm(content, decisions, choose) {
  const said = make("p", { role: "status" });
  const field = (label) => make("input", { type: "text", list: "scan-names", "aria-label": label, placeholder: label, autocomplete: "off" });
  const [one, other] = [field("one scan"), field("the other scan")];
  const scanOf = (input) => decisions.index.get(input.value) ?? decisions.index.get(input.value.trim());
  const add = () => {
    const scans = [scanOf(one), scanOf(other)];
    const wrong = [one, other].find((_, k) => scans[k] === undefined);
    if (wrong) said.textContent = `${wrong.value ? `"${wrong.value}" is not a scan of this map` : "Name two scans"}; the list offers their names.`;
    else if (scans[0] === scans[1]) said.textContent = "A tie joins two different scans.";
    else {
      const pair = decisions.pairOf(decisions.between(...scans));
      const verdict = decisions.inFavor(pair);
      said.textContent = verdict === "add" ? "Added: `sonarmap map` will register the pair." : "The map tried this pair already: it is accepted.";
      decisions.decide(pair, verdict);
      choose(pair, false);
      one.value = other.value = "";
    }
  };
  return make("form", { class: "filter", onsubmit: (event) => (event.preventDefault(), add()) },
    make("datalist", { id: "scan-names" }, ...content.names.map((name) => make("option", { value: name }))),
    one, other, make("button", { type: "submit" }, "Tie the two"), said);
}

/** Save, and back to what the map was made with. */
function fileButtons(decisions, kind, text) {
  const said = make("p", { role: "status" });
  const save = () => {
    said.textContent = "";
    try {
      saveFile(`${kind}.csv`, text());
    } catch (error) {
      said.textContent = error.message;
    }
  };
  const buttons = make("div", { class: "buttons" },
    button(`Save ${kind}.csv`, save, { class: "save" }), button("Discard new decisions", () => decisions.forget(kind)), said);
  const update = () => {
    buttons.hidden = !decisions[kind].length;
    if (decisions.lost) said.textContent = "This browser keeps nothing for pages on disk: save the file before you close this page.";
  };
  follow(decisions, update);
  return [buttons];
}

/** The folder of this page, quoted for a POSIX shell: that of the map, whose pairs are not registered again. */
function ownFolder() {
  const folder = location.protocol === "file:" ? decodeURIComponent(location.pathname).replace(/\/[^/]*$/, "") : "map";
  return /^[\w@%+=:,.\/-]+$/.test(folder) ? folder : `'${folder.replaceAll("'", "'\"'\"'")}'`;
}

/** The command that makes the map again with the files that there are. */
function commandBox(decisions) {
  const said = make("p");
  const command = make("code", { class: "command", tabindex: 0 });
  const box = make("div", {}, make("p", {}, `Then run this where you ran the first map, with the files there; add any other options that
    you gave. Click on it to select it.`), command, said);
  const update = () => {
    const files = ["ties", "control"].filter((kind) => decisions[kind].length).map((kind) => ` --${kind} ${kind}.csv`);
    if (inGrid(decisions.control)) files.push(" --control-crs EPSG:CODE");
    const { options, inputs } = decisions.content.command;
    said.textContent = inGrid(decisions.control)
      ? "Put the grid of your coordinates in place of CODE, such as EPSG:25832 for ETRS89 / UTM zone 32N." : "";
    command.textContent = `${options} -o ${ownFolder()}${files.join("")} ${inputs}`;
    box.hidden = !files.length;
  };
  follow(decisions, update);
  return box;
}

/** Beside the map: how much is decided, and the files. */
function showDecided(box, decisions) {
  const rows = [["ties", "tie", "by hand", tiesFile], ["control", "control point", "", controlFile]].filter(([kind]) => decisions[kind].length);
  box.replaceChildren(...rows.map(([kind, what, how, text]) => {
    const save = () => {
      try {
        saveFile(`${kind}.csv`, text(decisions));
      } catch {
        document.querySelector(`#${kind} .save`).click(); // says there what is wrong
        document.querySelector(`#${kind}`).scrollIntoView();
      }
    };
    const words = `${counted(decisions[kind].length, what)} ${how}`.trim();
    return make("p", {}, make("a", { href: `#${kind}` }, words), " ", button(`Save ${kind}.csv`, save));
  }));
}
