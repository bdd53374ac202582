// The page: what comes by the WebSocket, in words and in the views. Texts become text nodes, never markup.

const $ = (selector) => document.querySelector(selector);
const AGAIN = [500, 5000]; // until the next try to reach the server, at first and at most [ms]
const OLD = 5, MISSED = 4; // news is, after so long [s], and after so many messages that did not come
const dive = new Dive();
let view = null;
let receivedAt = performance.now(), usual = 0, pause = AGAIN[0], lostSince = null;
const wire = { bytes: 0, messages: 0, open: false };

/** How long something takes, such as "1 min 5 s". */
const lasting = (seconds) => (seconds < 60 ? `${Math.floor(seconds)} s` : `${Math.floor(seconds / 60)} min ${Math.floor(seconds % 60)} s`);

const place = (xyz) => `x ${xyz[0].toFixed(1)}, y ${xyz[1].toFixed(1)}, z ${xyz[2].toFixed(1)} m`;

/** What is known of the dive as [name, value]. */
function factsOf(state) {
  const { vehicle } = state, spread = vehicle ? Math.sqrt([0, 1, 2].reduce((all, k) => all + vehicle.covariance[k][k], 0)) : null;
  const measured = [["below the start", state.depth, "m"], ["speed", state.speed, "m/s"], ["turn rate", state.turn_rate, "°/s"]];
  return [
    ...measured.map(([name, value, unit]) => [name, value === null || value === undefined ? "–" : `${value.toFixed(1)}\u202f${unit}`]),
    ["placed within (95 %)", spread === null ? "–" : meters(CONFIDENCE * spread)],
    ["scans placed", `${state.placed ?? 0} of ${state.scans ?? 0}`], ["scans behind", state.behind ?? 0],
    ["key scans", state.keys ?? 0], ["loops", state.loops ?? 0], ["separate maps", state.parts ?? 0],
  ];
}

/** Change a text only where it differs, so that it is read out once. */
function say(selector, text) {
  if ($(selector).textContent !== text) $(selector).textContent = text;
}

function showState() {
  const { state } = dive, lost = state.status === "lost", sure = state.last_sure;
  lostSince = state.lost_since === null || state.lost_since === undefined ? null : performance.now() - 1000 * state.lost_since;
  document.body.dataset.status = state.status;
  document.title = `${lost ? "LOST: " : ""}sonarmap live`;
  say("#sentence", state.sentence);
  say("#announced", `Now ${state.status}.`); // once, though numbers in the sentence change all the time
  const back = !lost ? "" : sure
    ? `The vehicle is lost. Go back to the last sure place: ${place(sure.place)}${state.parts > 1 ? ` of part ${sure.part}` : ""}.`
    : "The vehicle is lost, and no place was sure before.";
  if ($("#alarm").firstChild?.textContent !== back) $("#alarm").replaceChildren(back, " ", sure && view ? button("Show it", showSure) : "");
  $("#alarm").hidden = !lost;
  const concerns = state.alerts.filter((text) => text);
  if ([...$("#concerns").children].map((item) => item.textContent).join("\n") !== concerns.join("\n"))
    $("#concerns").replaceChildren(...concerns.map((text) => make("li", {}, text)));
  $("#facts").replaceChildren(...factsOf(state).map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
  showAge();
}

/** Look at the last sure place, in the part that it is in. */
function showSure() {
  const { part, place } = dive.state.last_sure;
  view.chosen = part === dive.state.part ? null : part;
  view.setFollow(false);
  view.camera.lookAt(place);
  view.refresh();
}

/** What grows older by itself: for how long the vehicle is lost, and since when there is no news. */
function showAge() {
  const { state } = dive, age = (performance.now() - receivedAt) / 1000;
  const waits = wire.open && age > Math.max(OLD, MISSED * usual) && !["waiting", "ended"].includes(state.status);
  $("#status").textContent = state.status === "lost" ? `LOST${lostSince === null ? "" : ` for ${lasting((performance.now() - lostSince) / 1000)}`}` : state.status;
  document.body.classList.toggle("stale", !wire.open || waits);
  if (wire.open) say("#link", waits ? `No news from the mapping for ${lasting(age)}: what is shown is old.` : "");
  $("#link").hidden = !$("#link").textContent;
}

/** What the map shows in one sentence, the legend, the choice of parts, and the plan. */
function showMap() {
  const number = view?.part.number ?? dive.state.part ?? 0, parts = [...new Set(dive.poses.map(({ part }) => part))].sort((a, b) => a - b);
  const keys = [...dive.clouds.values()].filter(({ key }) => dive.isIn(number, key));
  const points = keys.reduce((all, { count }) => all + count, 0);
  const loops = dive.loopPieces(number).length;
  const shown = `${counted(points, "point")} of ${counted(keys.length, "key scan")}${parts.length > 1 ? ` of part ${number}` : ""}, colored by height`;
  say("#said", `Shown: ${shown}; the last scan in pink, the track in orange${loops ? `, ${counted(loops, "loop")} in blue` : ""}, and the vehicle as an arrow, in an ellipsoid that contains it with a probability of 95 %.`);
  showPlan();
  if (!view) return;
  if (keys.length) showLegend($("#legend"), view);
  $("#follow").setAttribute("aria-pressed", view.follow);
  $("#parts").hidden = parts.length < 2;
  const listed = [["", "that of the vehicle"], ...parts.map((part) => [part, `part ${part}`])];
  if ($("#parts").dataset.listed === String(listed) && document.activeElement === $("#parts select")) return; // it may be open
  $("#parts").dataset.listed = String(listed);
  $("#parts").replaceChildren("Part of the map ", choice(listed, { onchange: (event) => {
    view.chosen = event.target.value === "" ? null : Number(event.target.value);
    view.showAll();
    view.setFollow(view.chosen === null);
    view.refresh();
  } }, view.chosen ?? ""));
}

function showPlan() {
  const number = view?.part.number ?? dive.state.part ?? 0, { state } = dive;
  const vehicle = state.part === number ? state.vehicle : null, sure = state.last_sure?.part === number ? state.last_sure.place : null;
  showCoverage($("#coverage"), dive.coverage.get(number), vehicle, sure, state.status);
}

function receive(message) {
  wire.messages++;
  wire.bytes += typeof message === "string" ? message.length : message.byteLength;
  const change = dive.take(message);
  view?.show(change);
  if (change.kind === "state") {
    usual += 0.1 * ((performance.now() - receivedAt) / 1000 - usual);
    receivedAt = performance.now();
    showState();
  }
  if (change.kind === "reset") showState();
  if (change.kind === "state" || change.kind === "coverage") showPlan();
  if (!view) showMap();
}

/** Open the feed, and again whenever it ends; the server then sends all that there is. */
function connect() {
  const socket = new WebSocket(`feed${location.search}`.replace(/^/, `${location.origin.replace(/^http/, "ws")}/`));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    [pause, wire.open] = [AGAIN[0], true];
    say("#link", "");
    receive('{"kind":"reset"}');
  };
  socket.onmessage = ({ data }) => receive(data);
  socket.onclose = ({ reason }) => {
    wire.open = false;
    const why = reason ? ` (${reason})` : "";
    say("#link", dive.state.status === "ended" ? "The mapping has ended; this is the map as it was then."
      : `There is no connection to sonarmap${why}; trying again. What is shown is what came last.`);
    setTimeout(connect, pause);
    pause = Math.min(AGAIN[1], 2 * pause);
    showAge();
  };
}

function withoutView(why) {
  view = null;
  $("#stage").replaceChildren(make("p", { class: "notice" }, `The map in 3D cannot be shown: ${why}. The state and the plan go on.`));
}

$("#theme").addEventListener("click", () => {
  const root = document.documentElement;
  root.dataset.theme = getComputedStyle(root).colorScheme === "dark" ? "light" : "dark";
  view?.request();
  showPlan();
});
try {
  view = new LiveView($("#stage"), dive);
  view.changed = showMap;
  view.canvas.addEventListener("webglcontextlost", () => withoutView("the graphics driver stopped; loading the page again may help"));
  view.canvas.addEventListener("keydown", ({ key }) => key.toLowerCase() === "f" && view.setFollow(true));
  $("#follow").addEventListener("click", () => view.setFollow(!view.follow));
  for (const [id, look] of [["#above", () => view.camera.fromAbove()], ["#all", () => view.showAll()]])
    $(id).addEventListener("click", () => {
      look();
      view.request(id === "#all");
    });
} catch (error) {
  withoutView(`${error.message}; this browser, or this machine's graphics driver, does not offer it`);
}
setInterval(showAge, 1000);
connect();
// For scripts that measure in the page.
window.sonarmap = { dive, view, wire };
