// The plan of what was seen how often: where to go next, and what would be left out.

const SEEN = [ // least count, color, words
  [4, "#0072b2", "4 times or more"], [2, "#56b4e9", "2 or 3 times"], [1, "#e69f00", "once"], [0, "#d55e00", "holes, never seen"],
];
const LEAST_HOLE = 4; // cells: smaller gaps lie between beams
const HIGHEST = 260; // the plan [pixels]

/** Which cells were never seen, but lie within what was: 1 for each. */
function holesOf({ width, height, counts }) {
  const holes = new Uint8Array(counts.length), visited = new Uint8Array(counts.length);
  for (let start = 0; start < counts.length; start++) {
    if (counts[start] || visited[start]) continue;
    const cells = [start];
    let open = false; // toward the border
    visited[start] = 1;
    for (let k = 0; k < cells.length; k++) {
      const x = cells[k] % width, y = (cells[k] - x) / width;
      if (!x || !y || x === width - 1 || y === height - 1) open = true;
      for (const [near, inside] of [[cells[k] - 1, x], [cells[k] + 1, x < width - 1], [cells[k] - width, y], [cells[k] + width, y < height - 1]])
        if (inside && !counts[near] && !visited[near]) visited[cells.push(near) && near] = 1;
    }
    if (!open && cells.length >= LEAST_HOLE) for (const cell of cells) holes[cell] = 1;
  }
  return holes;
}

/** Draw the plan of a part with the vehicle, and write its legend. */
function showCoverage(box, coverage, vehicle, sure, status) {
  box.hidden = !coverage;
  if (!coverage) return;
  const { width, height, cell, corner, counts } = coverage;
  const canvas = box.querySelector("canvas"), pen = canvas.getContext("2d"), ratio = Math.min(2, window.devicePixelRatio || 1);
  if (!coverage.picture) {
    const holes = holesOf(coverage), areas = SEEN.map(() => 0);
    const colors = SEEN.map(([, color]) => [1, 3, 5].map((at) => parseInt(color.slice(at, at + 2), 16)));
    const image = new ImageData(width, height);
    counts.forEach((count, k) => {
      if (!count && !holes[k]) return;
      const kind = SEEN.findIndex(([least]) => count >= least);
      areas[kind] += cell * cell;
      image.data.set([...colors[kind], 255], 4 * ((height - 1 - Math.floor(k / width)) * width + (k % width)));
    });
    coverage.picture = new OffscreenCanvas(width, height);
    coverage.picture.getContext("2d").putImageData(image, 0, 0);
    box.querySelector("ul").replaceChildren(...SEEN.map(([, color, words], k) => {
      const patch = Object.assign(make("span", { class: "patch" }), { style: `background: ${color}` });
      return make("li", {}, patch, `${words}: ${short(areas[k], "m²")}`);
    }), make("li", {}, "no color: never seen, and outside"));
  }
  const wide = Math.min(box.clientWidth - 24, (HIGHEST * width) / height), scale = (wide * ratio) / width;
  canvas.style.width = `${wide}px`;
  [canvas.width, canvas.height] = [width * scale, height * scale].map(Math.round);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(coverage.picture, 0, 0, canvas.width, canvas.height);
  const at = ([x, y]) => [((x - corner[0]) / cell) * scale, canvas.height - ((y - corner[1]) / cell) * scale];
  const ink = getComputedStyle(box).color;
  const mark = (pieces, color, wide) => {
    Object.assign(pen, { strokeStyle: color, lineWidth: wide * ratio, lineCap: "round" });
    pen.stroke(new Path2D(pieces));
  };
  if (sure && status === "lost") {
    const [x, y] = at(sure), s = 5 * ratio;
    mark(`M${x - s} ${y - s}L${x + s} ${y + s}M${x - s} ${y + s}L${x + s} ${y - s}`, ink, 3);
  }
  if (vehicle) {
    const [x, y] = at(vehicle.pose), [fx, fy] = turned(vehicle.pose.slice(3), [1, 0, 0]), s = (9 * ratio) / (Math.hypot(fx, fy) || 1);
    const [u, v] = [fx * s, -fy * s];
    mark(`M${x - u} ${y - v}L${x + u} ${y + v}L${x - 0.6 * v} ${y + 0.6 * u}M${x + u} ${y + v}L${x + 0.6 * v} ${y - 0.6 * u}`, ink, 3);
  }
}
