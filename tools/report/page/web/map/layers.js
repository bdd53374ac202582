// The lines of the map: the way, its ellipsoids and the loops, as pieces [[begin, end], ...] [m].

const LINES = {
  way: { color: [0.9, 0.35, 0], width: 2.5, dash: 0 },
  ellipsoids: { color: [0.9, 0.35, 0], width: 1, dash: 0 },
  kept: { color: [0.2, 0.62, 0.95], width: 1.2, dash: 0 },
  refused: { color: [0.85, 0.4, 0.7], width: 1.5, dash: 6 },
  chosen: { color: [1, 0.85, 0.1], width: 4, dash: 0, hidden: 0.75 },
  measured: { color: [1, 1, 1], width: 2.5, dash: 0, hidden: 0.75 },
};
const CONFIDENCE = 2.7955; // standard deviations of a place in space that hold 95 %
const CIRCLE = 24; // pieces of a circle
const MOST_ELLIPSOIDS = 400;

/** From pose to pose, but not from one survey to another. */
function wayPieces(way, surveys) {
  const pieces = [];
  for (let k = 1; k < way.places.length; k++)
    if (surveys[way.scans[k - 1]] === surveys[way.scans[k]]) pieces.push([way.places[k - 1], way.places[k]]);
  return pieces;
}

/** Three circles about each pose: where it lies with 95 %, enlarged by a factor. */
function ellipsoidPieces(way, factor) {
  const pieces = [];
  const step = Math.ceil(way.places.length / MOST_ELLIPSOIDS);
  for (let k = 0; k < way.places.length; k += step)
    for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) {
      const [first, second] = [way.half_axes[k][a], way.half_axes[k][b]];
      const at = (turn) => {
        const [c, s] = [Math.cos(turn), Math.sin(turn)].map((value) => CONFIDENCE * factor * value);
        return sum(sum(way.places[k], first, c), second, s);
      };
      for (let t = 0; t < CIRCLE; t++)
        pieces.push([at((2 * Math.PI * t) / CIRCLE), at((2 * Math.PI * (t + 1)) / CIRCLE)]);
    }
  return pieces;
}

/** The factor of 1, 10, 100 that makes ellipsoids visible but not large in a map of this reach [m]. */
function fittingFactor(way, reach) {
  const sizes = way.half_axes.map((axes) => CONFIDENCE * Math.max(...axes.map(lengthOf))).sort((a, b) => a - b);
  const typical = sizes[sizes.length >> 1];
  return [100, 10].find((factor) => factor * typical < 0.012 * reach) ?? 1;
}

/** The loops and other pairs within a part of the map, each with the places of its scans. */
function pairsOf(part, pairs) {
  const place = new Map(part.way.scans.map((scan, k) => [scan, part.way.places[k]]));
  return pairs
    .filter((pair) => place.has(pair.target) && place.has(pair.source))
    .map((pair) => ({ ...pair, ends: [place.get(pair.target), place.get(pair.source)] }));
}
