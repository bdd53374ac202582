// What stands over the map: names of places, where the axes point, and how long a bar is.

const BAR = 140; // the longest [pixels]
const [LETTER, LINE] = [7, 19]; // about a letter's width, and a line's height [pixels]

/** Put labels, [[place, text], ...], compass and scale where they belong in this frame. */
function putLabels(view, labels) {
  const box = view.stage.querySelector("#labels");
  const taken = [];
  box.replaceChildren(...labels.map(([place, text]) => {
    const [x, y, depth] = view.camera.project(place);
    const label = make("span", { class: text.length === 1 ? "mark" : "", hidden: depth <= 0 }, text);
    label.style.transform = `translate(${x.toFixed(1)}px, ${freeHeight(taken, [x, y], text).toFixed(1)}px)`;
    return label;
  }));
  drawCompass(view);
  drawBar(view);
}

/** How high a text may stand [pixels]: lower than its place where it would cover one before it. */
function freeHeight(taken, [x, y], text) {
  const width = text.length * LETTER + 20;
  const covers = (other) => Math.abs(other.y - y) < LINE && x < other.x + other.width && other.x < x + width;
  for (let turn = 0; text.length > 1 && turn < 4 && taken.some(covers); turn++) y += LINE;
  taken.push({ x, y, width });
  return y;
}

function drawCompass({ stage, camera, part }) {
  const { right, up, ahead } = camera.axes();
  const axes = part.axes.map((name, k) => ({ name: name[0], x: 26 * right[k], y: -26 * up[k], away: ahead[k], k }));
  axes.sort((a, b) => b.away - a.away); // what is farther first
  const drawn = axes.flatMap(({ name, x, y, k }) => [
    make("line", { x1: 0, y1: 0, x2: x, y2: y, class: `axis axis-${k}` }),
    make("text", { x: 1.35 * x, y: 1.35 * y + 4, "text-anchor": "middle" }, name),
  ]);
  stage.querySelector("#compass").replaceChildren(...drawn);
}

/** A bar of a round length at the middle of the picture. */
function drawBar({ stage, camera }) {
  const longest = BAR * camera.pixel();
  const power = 10 ** Math.floor(Math.log10(longest));
  const size = [5, 2, 1].map((factor) => factor * power).find((length) => length <= longest);
  const bar = stage.querySelector("#bar");
  bar.style.width = `${(size / camera.pixel()).toFixed(1)}px`;
  bar.firstElementChild.textContent = `${short(size, "m")} at the middle`;
}
