// The page: read what is embedded in it, show it, and tie the map to the sections.

const content = JSON.parse($("#content-json").textContent);
const pictures = JSON.parse($("#pictures-json").textContent);
const decisions = new Decisions(content);
let view = null;

async function showPart(number) {
  const part = content.parts[number];
  const points = unpack(part.packed, $(`#points-${number}`).textContent);
  view.showPart(part, await points.catch((error) => Promise.reject(new Error(`its points cannot be unpacked (${error.message})`))));
  showControls($("#controls"), view, content, number, showPart);
  $("#opening").hidden = true;
}

/** Show a pair in the map, in the part that holds it, and go there. */
async function choose(pair) {
  if (!view) return;
  const number = content.parts.findIndex(({ track }) => track.scans.includes(pair.target) && track.scans.includes(pair.source));
  if (number < 0) return showPicked($("#picked"), view, content, { pair });
  if (view.part !== content.parts[number]) await showPart(number);
  const [drawn] = pairsOf(view.part, [pair]);
  view.camera.lookAt(sum(...drawn.ends).map((value) => value / 2));
  view.choose(drawn);
  showPicked($("#picked"), view, content, { pair: drawn });
  $("#map").scrollIntoView({ block: "start" });
}

/** Whatever was decided shows everywhere. */
function showDecisions() {
  for (const buttons of document.querySelectorAll(".verdicts")) buttons.update();
  if (view?.part) view.showLayers();
}

function showSections() {
  $("#concerns").append(...content.verdict.concerns.map((concern) => make("li", {}, concern)));
  for (const [id, heading, elements] of sectionsOf(content, pictures, decisions, choose)) {
    $("main").append(make("section", { id }, make("h2", {}, heading), ...elements));
    $("nav").append(make("a", { href: `#${id}` }, heading));
  }
  $("footer").append(`Written by sonarmap ${content.versions.sonarmap ?? ""}. Lengths in meters, angles in degrees.`);
}

/** Pictures in place of the map, and a sentence that says why. */
function showPictures(why) {
  view = null;
  const shown = Object.entries(pictures).map(([name, url]) => picture(name, url));
  const instead = shown.length ? "Here are the pictures that were written with the map instead" : "Open map.ply in a viewer of point clouds instead";
  $("#map").replaceChildren(make("p", { class: "notice" }, `The map in 3D cannot be shown: ${why}. ${instead}.`), ...shown);
  for (const twice of ["#pictures", 'nav a[href="#pictures"]']) $(twice)?.remove();
}

showSections();
decisions.listeners.push(showDecisions);
showDecisions();
window.addEventListener("beforeunload", (event) => decisions.saved || event.preventDefault()); // the browser then asks the user
try {
  view = new ReportView($("#stage"), content, decisions, (hit) => showPicked($("#picked"), view, content, hit));
  view.canvas.addEventListener("webglcontextlost", () => showPictures("the graphics driver stopped; loading the page again may help"));
  await showPart(0);
} catch (error) {
  showPictures(error.message);
}
window.sonarmap = { content, view, decisions, unpack, placeOf, degreesOf }; // for scripts that measure in the page: docs/report.md
