// The page: what comes by the WebSocket, in words, in the views, and in the plan. Texts become text nodes, never markup.

const MARK = 0.025; // half a mark's size, as a share of the plan's

/** Show the plan of a part, its track, and vehicle {place, turn} and last sure place, where there are such; the vehicle's heading up if `ahead`. */
function showCoverage(box, coverage, track, vehicle, sure, ahead) {
  box.hidden = !coverage;
  if (!coverage) return;
  const { corner, size: [width, height], legend, picture } = coverage, s = MARK * Math.max(width, height);
  const [fx, fy] = vehicle ? turned(vehicle.turn, [1, 0, 0]) : [0, 1], hole = vehicle && showHole(coverage.holes, vehicle.place, [fx, fy]);
  const line = (...places) => `M${places.map(([x, y]) => [x - corner[0], height - (y - corner[1])]).join("L")}`;
  const near = (far, left) => sum(vehicle.place, [far * fx - left * fy, far * fy + left * fx, 0], s);
  const marks = [...track, ...crosses(sure ? [sure] : [], s), ...(hole ? [[vehicle.place, hole]] : [])].map((places) => line(...places));
  if (vehicle) marks.push(line(near(-2, 0), near(2, 0)), line(near(0, -1.2), near(2, 0), near(0, 1.2)));
  const plan = box.querySelector("svg"), across = ahead ? Math.hypot(width, height) : null;
  const [left, top] = ahead ? [(width - across) / 2, (height - across) / 2] : [-2 * s, -2 * s];
  plan.setAttribute("viewBox", `${left} ${top} ${width - 2 * left} ${height - 2 * top}`);
  plan.querySelector("g").setAttribute("transform", `rotate(${ahead ? (-180 / Math.PI) * Math.atan2(fx, fy) : 0} ${width / 2} ${height / 2})`);
  if (plan.dataset.picture !== picture) {
    plan.dataset.picture = picture;
    for (const [name, value] of Object.entries({ href: picture, width, height })) plan.querySelector("image").setAttribute(name, value);
    box.querySelector("ul").replaceChildren(...legend.map(([color, words, area]) => {
      const patch = Object.assign(make("span", { class: "patch" }), { style: `background: ${color}` });
      return make("li", {}, patch, `${words}: ${short(area, "m²")}`);
    }), make("li", {}, "no color: never seen, and outside"));
  }
  plan.querySelector("path").setAttribute("d", marks.join(""));
  plan.querySelector("path").setAttribute("stroke-width", s / 3);
}

/** How to fly to the nearest of the holes [x, y] from a place, with an arrow: its bearing from what is ahead. That hole, or undefined. */
function showHole(holes, place, [fx, fy]) {
  const far = ([x, y]) => Math.hypot(x - place[0], y - place[1]), [hole] = [...holes].sort((a, b) => far(a) - far(b));
  $("#hole").hidden = !hole;
  if (!hole) return hole;
  const [x, y] = minus(hole, place), left = Math.round((180 / Math.PI) * Math.atan2(fx * y - fy * x, fx * x + fy * y));
  say("#hole output", `hole ${meters(far(hole), 1)}, ${Math.abs(left)}°\u202f${left < 0 ? "right" : "left"}`);
  $("#hole span").style.rotate = `${-left}deg`;
  return hole;
}

const AGAIN = [500, 5000]; // until the next try to reach the server, at first and at most [ms]
const OLD = 10000; // news is [ms]: they come each second, and later while a hard pair is registered
const dive = new Dive(), wire = { bytes: 0, messages: 0, open: false };
const BEEP = [300, 1500]; // a tone, and from one to the next [ms]
let view = null, audio = null, receivedAt = performance.now(), pause = AGAIN[0];

/** Change a text only where it differs, so that it is read out once. */
function say(selector, text) {
  if ($(selector).textContent !== text) $(selector).textContent = text;
}

function showState() {
  const { state } = dive, { status, sure } = state, lost = status === "lost";
  document.body.dataset.status = status;
  document.title = `${lost ? "LOST: " : ""}sonarmap live`;
  say("#status", lost ? "LOST" : status);
  say("#sentence", state.sentence);
  const [x, y, z] = sure?.[1].map((value) => value.toFixed(1)) ?? [], of = state.parts > 1 ? ` of part ${sure?.[0]}` : "";
  say("#back", sure ? `The vehicle is lost. Go back to the last sure place: x ${x}, y ${y}, z ${z} m${of}.`
    : "The vehicle is lost, and no place was sure before.");
  $("#alarm").hidden = !lost;
  $("#sure").hidden = !sure || !view;
  const said = [...state.alerts, ...state.choices], choice = (text) => button(text, () => wire.open && wire.socket.send(text));
  if ([...$("#concerns").children].map((item) => item.textContent).join() !== said.join()) // a button stays while it is pressed
    $("#concerns").replaceChildren(...said.map((text) => make("li", {}, state.choices.includes(text) ? choice(text) : text)));
  const facts = [
    ["below the start", state.depth, "\u202fm"], [state.north ? "heading" : "heading from the start's", state.heading, "°", 0],
    ["speed", state.speed, "\u202fm/s"], ["over the bed", state.altitude, "\u202fm"], ["to the wall ahead", state.ahead, "\u202fm"],
  ].map(([name, value, unit, decimals = 1]) => [name, value?.toFixed ? `${value.toFixed(decimals)}${unit}` : "–"]);
  const held = Number.isFinite(state.held) ? `${Math.floor(state.held / 60)}:${String(Math.floor(state.held % 60)).padStart(2, "0")}` : "–";
  $("#facts").replaceChildren(...[[lost ? "LOST for" : "placed for", held], ...facts].map(([name, text]) =>
    make("div", {}, make("dt", {}, name), make("dd", {}, text))));
  showPlan();
}

/** Look at the last sure place, in the part that it is in. */
function showSure() {
  const [part, place] = dive.state.sure;
  view.setFollow(false);
  view.chosen = part;
  view.camera.lookAt(place);
  view.refresh();
}

/** What the map shows in one sentence, and the legend. */
function showMap() {
  const { number } = view.part, keys = dive.cloudsIn(number), loops = dive.between(number, dive.loops).length;
  const points = keys.reduce((all, { count }) => all + count, 0), of = dive.state.parts > 1 ? ` of part ${number}` : "";
  say("#said", `Shown: ${counted(points, "point")} of ${counted(keys.length, "key scan")}${of}; the last scan in pink, the track in orange${loops ? `, ${counted(loops, "loop")} in blue` : ""}, and the vehicle as an arrow, in an ellipsoid that contains it with a probability of 95 %.`);
  if (keys.length) showLegend($("#legend"), view.colorings[view.colored]);
  $("#colored").value = view.colored;
  $("#follow").setAttribute("aria-pressed", view.follow);
  showPlan();
}

function showPlan() {
  const { state } = dive, { vehicle, sure } = view?.seen() ?? {};
  const part = view?.part.number ?? state.part, ahead = $("#ahead").getAttribute("aria-pressed") === "true";
  showCoverage($("#coverage"), dive.coverage.get(part), dive.trackPieces(part), vehicle, state.status === "lost" && sure, ahead);
}

function toggle(selector, changed) {
  $(selector).addEventListener("click", ({ target }) => changed(target.setAttribute("aria-pressed", target.getAttribute("aria-pressed") !== "true")));
}

/** A tone while the vehicle is lost. Browsers allow it once the user has clicked or typed, and complain before. */
function sound() {
  const wanted = dive.state.status === "lost" && $("#sound").getAttribute("aria-pressed") === "true";
  if (!wanted || !navigator.userActivation?.hasBeenActive) return;
  audio ??= new AudioContext();
  const tone = new OscillatorNode(audio, { frequency: 880 });
  tone.connect(audio.destination);
  tone.start();
  tone.stop(audio.currentTime + BEEP[0] / 1000);
}

function receive(message) {
  wire.messages++;
  wire.bytes += message.length ?? message.byteLength;
  const change = dive.take(message);
  view?.show(change);
  if (change.kind === "state") receivedAt = performance.now();
  if (["state", "reset", "coverage"].includes(change.kind)) showState();
  if (change.kind === "made") location.assign(`/report${location.search}`);
}

/** Say whether what is shown is old. */
function showAge() {
  const age = performance.now() - receivedAt, waits = wire.open && age > OLD && !["waiting", "ended"].includes(dive.state.status);
  document.body.classList.toggle("stale", !wire.open || waits);
  if (wire.open) say("#link", waits ? `No news from the mapping for ${Math.round(age / 1000)} s: what is shown is old.` : dive.making);
  $("#link").hidden = !$("#link").textContent;
}

/** Open the feed, and again whenever it ends; the server then sends all that there is. */
function connect() {
  const socket = (wire.socket = new WebSocket(`${location.origin.replace("http", "ws")}/feed${location.search}`));
  socket.binaryType = "arraybuffer";
  socket.onopen = () => {
    [pause, wire.open] = [AGAIN[0], true];
    receive('{"kind":"reset"}');
    showAge();
  };
  socket.onmessage = ({ data }) => receive(data);
  socket.onclose = ({ reason }) => {
    wire.open = false;
    say("#link", dive.state.status === "ended" ? "The mapping has ended; this is the map as it was then."
      : `There is no connection to sonarmap${reason && ` (${reason})`}; trying again. What is shown is what came last.`);
    setTimeout(connect, pause);
    pause = Math.min(AGAIN[1], 2 * pause);
    showAge();
  };
}

function withoutView(why) {
  view = null;
  $("#stage").replaceChildren(make("p", { class: "notice" }, `The map in 3D cannot be shown: ${why}. The state and the plan go on.`));
}

try {
  view = new LiveView($("#stage"), dive);
  view.changed = showMap;
  view.canvas.addEventListener("webglcontextlost", () => withoutView("the graphics driver stopped; loading the page again may help"));
  const keys = { f: () => view.setFollow(true), c: () => view.colorBy() }; // which do not end following
  view.canvas.addEventListener("keydown", ({ key }) => keys[key.toLowerCase()]?.());
  $("#follow").addEventListener("click", () => view.setFollow(!view.follow));
  $("#colored").append(...Object.keys(view.colorings).map((name) => make("option", {}, name)));
  $("#colored").addEventListener("change", ({ target }) => view.colorBy(target.value));
  $("#above").addEventListener("click", () => (view.camera.fromAbove(), view.request()));
  $("#all").addEventListener("click", () => (view.camera.reset(), view.request(true)));
  $("#sure").addEventListener("click", showSure);
} catch (error) {
  withoutView(error.message);
}
toggle("#ahead", showPlan);
toggle("#sound", sound);
setInterval(sound, BEEP[1]);
setInterval(showAge, 1000);
connect();
window.sonarmap = { dive, view, wire }; // for scripts that measure in the page
