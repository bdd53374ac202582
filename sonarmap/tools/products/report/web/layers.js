// The lines of the map: the track, its ellipsoids and the loops, as pieces [[begin, end], ...] [m].

const LINES = {
  track: { color: [0.9, 0.35, 0], width: 2.5 },
  ellipsoids: { color: [0.9, 0.35, 0], width: 1 },
  kept: { color: [0.2, 0.62, 0.95], width: 1.2 },
  refused: { color: [0.85, 0.4, 0.7], width: 1.5, dash: 6 },
  accepted: { color: [0, 0.62, 0.45], width: 3.5 },
  rejected: { color: [0.85, 0.4, 0.7], width: 3.5, dash: 6 },
  control: { color: [0.84, 0.37, 0], width: 2.5, hidden: 0.75 },
  residuals: { color: [0.9, 0.1, 0.1], width: 2.5, hidden: 0.75 },
  chosen: { color: [1, 0.85, 0.1], width: 6, hidden: 0.75 },
  field: { color: PALETTE[LAST_TEXEL].map((value) => value / 255), width: 1.5 },
  measured: { color: [0.55, 0.25, 0.85], width: 2.5, hidden: 0.75 },
};
const CONFIDENCE = 2.7955; // standard deviations of a place in space that hold 95 %
const CIRCLE = 24; // pieces of a circle
const MOST_ELLIPSOIDS = 400;

/** From pose to pose, but not from one survey to another. */
function trackPieces({ scans, places }, surveys) {
  const pieces = [];
  for (let k = 1; k < places.length; k++)
    if (surveys[scans[k - 1]] === surveys[scans[k]]) pieces.push([places[k - 1], places[k]]);
  return pieces;
}

/** Three circles about each pose: where it lies with 95 %, enlarged by a factor. */
function ellipsoidPieces(track, factor) {
  const pieces = [];
  const step = Math.ceil(track.places.length / MOST_ELLIPSOIDS);
  for (let k = 0; k < track.places.length; k += step)
    for (const [a, b] of [[0, 1], [1, 2], [2, 0]]) {
      const [first, second] = [track.half_axes[k][a], track.half_axes[k][b]];
      const at = (turn) => {
        const [c, s] = [Math.cos(turn), Math.sin(turn)].map((value) => CONFIDENCE * factor * value);
        return sum(sum(track.places[k], first, c), second, s);
      };
      for (let t = 0; t < CIRCLE; t++)
        pieces.push([at((2 * Math.PI * t) / CIRCLE), at((2 * Math.PI * (t + 1)) / CIRCLE)]);
    }
  return pieces;
}

/** The largest of 1000, 100 and 10 by which a length [m] stays below another, or else 1. */
const enlargement = (length, most) => [1000, 100, 10].find((factor) => factor * length < most) ?? 1;

/** The loops and other pairs within a part of the map, each with the places of its scans. */
function pairsOf(part, pairs) {
  const place = new Map(part.track.scans.map((scan, k) => [scan, part.track.places[k]]));
  return pairs
    .filter((pair) => place.has(pair.target) && place.has(pair.source))
    .map((pair) => ({ ...pair, ends: [place.get(pair.target), place.get(pair.source)] }));
}

function decidedPairs(part, decisions) {
  return pairsOf(part, decisions.ties.map((tie) => ({ ...decisions.pairOf(tie), verdict: tie.verdict })));
}

/** Control points of a part: {name, known place [m] in the part's own frame, row}. */
function controlOf(part, content) {
  const index = new Map(part.track.scans.map((scan, k) => [content.names[scan], k]));
  return content.control_points
    .filter((row) => index.has(row.scan) && (row.counted || row.left_out)) // where the part lies in the world
    .map((row) => {
      const place = fromSensor(poseOf(part.track, index.get(row.scan)), row.point);
      return { name: row.name, known: minus(place, row.residual), row };
    });
}

/** A cross at each known place, of arms [m]. */
const crosses = (places, arm) => places.flatMap((place) =>
  [0, 1, 2].map((axis) => [-arm, arm].map((by) => place.map((value, k) => value + (k === axis ? by : 0)))));

/** A line from each known place toward where the map has it, lengthened by a factor. */
const residualPieces = (points, factor) => points.map(({ known, row }) => [known, sum(known, row.residual, factor)]);

/** A vector turned by a quaternion x, y, z, w. */
function turned([x, y, z, w], v) {
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const t = cross([x, y, z], v).map((value) => 2 * value);
  return sum(sum(v, t, w), cross([x, y, z], t));
}

/** A place [m] of the frame of a pose {place, turn} in the part's frame, and back. */
const fromSensor = (pose, place) => sum(turned(pose.turn, place), pose.place);
const toSensor = ({ place: origin, turn: [x, y, z, w] }, place) => turned([-x, -y, -z, w], minus(place, origin));
const poseOf = ({ places, turns }, k) => ({ place: places[k], turn: turns[k] });
