// The plan of what was seen how often: the picture of coverage.py, with the vehicle and the last sure place on it.

const MARK = 0.025; // half a mark's size, as a share of the plan's

/** Show the plan of a part; vehicle {place, turn} and last sure place, where there are such. */
function showCoverage(box, coverage, vehicle, sure) {
  box.hidden = !coverage;
  if (!coverage) return;
  const { corner, size, legend, picture } = coverage, [width, height] = size, s = MARK * Math.max(width, height);
  const at = ([x, y]) => [x - corner[0], height - (y - corner[1])];
  const mark = (d) => make("path", { d, fill: "none", stroke: "currentColor", "stroke-width": s / 3 });
  const marks = [];
  if (sure) {
    const [x, y] = at(sure);
    marks.push(mark(`M${x - s} ${y - s}l${2 * s} ${2 * s}m${-2 * s} 0l${2 * s} ${-2 * s}`));
  }
  if (vehicle) {
    const [x, y] = at(vehicle.place), [fx, fy] = turned(vehicle.turn, [1, 0, 0]), [u, v] = [2 * s * fx, -2 * s * fy];
    marks.push(mark(`M${x - u} ${y - v}L${x + u} ${y + v}L${x - 0.6 * v} ${y + 0.6 * u}M${x + u} ${y + v}L${x + 0.6 * v} ${y - 0.6 * u}`));
  }
  const plan = box.querySelector("svg");
  plan.setAttribute("viewBox", `0 0 ${width} ${height}`);
  if (plan.dataset.picture !== picture) {
    plan.dataset.picture = picture;
    plan.querySelector("image").setAttribute("href", picture);
    for (const [name, value] of [["width", width], ["height", height]]) plan.querySelector("image").setAttribute(name, value);
    box.querySelector("ul").replaceChildren(...legend.map(([color, words, area]) => {
      const patch = Object.assign(make("span", { class: "patch" }), { style: `background: ${color}` });
      return make("li", {}, patch, `${words}: ${short(area, "m²")}`);
    }), make("li", {}, "no color: never seen, and outside"));
  }
  plan.querySelector("g").replaceChildren(...marks);
}
