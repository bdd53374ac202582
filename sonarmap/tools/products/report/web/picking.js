// Which point, pose or loop lies under the cursor.

/**
 * The number of the point that is seen at a pixel, or null: of those whose squares cover it the one in front, or of several up
 * to `deep` [m] behind that one the nearest to the pixel; where no square covers it, the nearest of the points within `NEAR`
 * pixels. `edge` is that of a square at a distance of 1 m [pixels]; no point lies outside the heights that are shown [m].
 */
function pointAt(points, camera, x, y, edge, deep, [lowest, highest]) {
  const { right, up, ahead } = camera.axes();
  const scale = camera.height / (2 * Math.tan(FIELD / 2));
  const { places, quantum } = points;
  const near = [];
  for (const tile of points.tiles) {
    const corner = minus(tile.origin, camera.target);
    const [r0, u0, a0] = [dot(corner, right), dot(corner, up), dot(corner, ahead) + camera.distance];
    for (let k = tile.start, at = 3 * k; k < tile.start + tile.count; k++, at += 3) {
      const px = quantum * places[at], py = quantum * places[at + 1], pz = quantum * places[at + 2];
      const height = tile.origin[2] + pz;
      if (height < lowest || height > highest) continue;
      const depth = a0 + px * ahead[0] + py * ahead[1] + pz * ahead[2];
      if (depth <= 0) continue;
      const half = Math.max(SQUARES[0], Math.min(SQUARES[1], edge / depth)) / 2, reach = Math.max(half, NEAR);
      const dx = Math.abs((scale * (r0 + px * right[0] + py * right[1] + pz * right[2])) / depth + camera.width / 2 - x);
      if (dx > reach) continue;
      const dy = Math.abs(camera.height / 2 - (scale * (u0 + px * up[0] + py * up[1] + pz * up[2])) / depth - y);
      if (dy <= reach) near.push({ k, depth, aside: Math.hypot(dx, dy), covers: dx <= half && dy <= half });
    }
  }
  const covering = near.filter(({ covers }) => covers);
  const front = covering.reduce((least, { depth }) => Math.min(least, depth), Infinity);
  const chosen = covering.length ? covering.filter(({ depth }) => depth <= front + deep) : near;
  return chosen.reduce((best, one) => (best && best.aside <= one.aside ? best : one), null)?.k ?? null;
}

/** Which of some places [m] is seen nearest to a pixel, within a radius [pixels]; null if none is. */
const placeAt = (places, camera, x, y, near) => lineAt(places.map((place) => [place, place]), camera, x, y, near);

/** Which of some lines [[begin, end], ...] [m] is seen nearest to a pixel, within a radius [pixels]; null if none is. */
function lineAt(lines, camera, x, y, near) {
  let best = null, least = near;
  lines.forEach(([begin, end], k) => {
    const [ax, ay, behind] = camera.project(begin), [bx, by, ahead] = camera.project(end);
    if (behind <= 0 || ahead <= 0) return;
    const far = (bx - ax) ** 2 + (by - ay) ** 2;
    const share = far ? Math.max(0, Math.min(1, ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / far)) : 0;
    const aside = Math.hypot(ax + share * (bx - ax) - x, ay + share * (by - ay) - y);
    if (aside < least) [best, least] = [k, aside];
  });
  return best;
}
