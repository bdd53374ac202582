// The page: read what is embedded in it, show it, and tie the map to the sections.

const $ = (selector) => document.querySelector(selector);
const content = JSON.parse($("#content-json").textContent);
const pictures = JSON.parse($("#pictures-json").textContent);
const unpacked = new Map();
let view = null;

/** The points of a part, unpacked when they are first asked for. */
function pointsOf(number) {
  if (!unpacked.has(number)) {
    const element = $(`#points-${number}`);
    unpacked.set(number, unpack(content.parts[number].packed, element.textContent));
    element.textContent = ""; // these megabytes are not needed twice
  }
  return unpacked.get(number);
}

async function showPart(number) {
  view.showPart(content.parts[number], await pointsOf(number));
  showControls($("#controls"), view, content, number, showPart);
  $("#opening").hidden = true;
}

/** Show a pair in the map, in the part that holds it. */
async function choose(pair) {
  if (!view) return;
  const number = content.parts.findIndex(({ way }) => way.scans.includes(pair.target) && way.scans.includes(pair.source));
  if (number < 0) return showPicked($("#picked"), view, content, { pair });
  if (view.part !== content.parts[number]) await showPart(number);
  const [drawn] = pairsOf(view.part, [pair]);
  view.camera.lookAt(sum(...drawn.ends).map((value) => value / 2));
  view.choose(drawn);
  showPicked($("#picked"), view, content, { pair: drawn });
  $("#map").scrollIntoView({ block: "start" });
}

function showSections() {
  $("#concerns").append(...content.verdict.concerns.map((concern) => make("li", {}, concern)));
  for (const [id, heading, elements] of sectionsOf(content, pictures, choose)) {
    $("main").append(make("section", { id }, make("h2", {}, heading), ...elements));
    $("nav").append(make("a", { href: `#${id}` }, heading));
  }
  $("footer").append(`Written by sonarmap ${content.versions.sonarmap ?? ""}. Lengths in meters, angles in degrees.`);
}

/** Pictures in place of the map, and a sentence that says why. */
function showPictures(why) {
  const shown = Object.entries(pictures).map(([name, url]) => picture(name, url));
  const instead = shown.length ? "Here are the pictures that were written with the map instead" : "Open map.ply in a viewer of point clouds instead";
  $("#map").replaceChildren(make("p", { class: "notice" }, `The map in 3D cannot be shown: ${why}. ${instead}.`), ...shown);
  for (const twice of ["#pictures", 'nav a[href="#pictures"]']) $(twice)?.remove();
}

$("#theme").addEventListener("click", () => {
  const root = document.documentElement;
  root.dataset.theme = getComputedStyle(root).colorScheme === "dark" ? "light" : "dark";
  view?.showMeasured();
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => view?.showMeasured());

showSections();
try {
  view = new View($("#stage"), content, (hit) => showPicked($("#picked"), view, content, hit));
} catch (error) {
  showPictures(`${error.message}; this browser, or this machine's graphics driver, does not offer it`);
}
if (view) {
  view.canvas.addEventListener("webglcontextlost", () => {
    view = null;
    showPictures("the graphics driver stopped; loading the page again may help");
  });
  try {
    await showPart(0);
    await new Promise(requestAnimationFrame);
    performance.mark("opened"); // the first frame is on its way
  } catch (error) {
    view = null;
    showPictures(`its points cannot be unpacked (${error.message})`);
  }
}
// For scripts that measure in the page: docs/report.md.
window.sonarmap = { content, view, unpack, placeOf, degreesOf };
