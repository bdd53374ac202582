// Latitude and longitude of places of a map: the twin of `Georeference.geodetic` in tools/files/geo.py.

const AXIS = 6378137, FLATTENING = 1 / 298.257223563; // of the WGS84 ellipsoid [m]
const ECCENTRICITY = FLATTENING * (2 - FLATTENING); // squared
const ROUNDS = 4; // of latitude and height: each leaves a hundredth of the error before, or less

/** [latitude, longitude] [deg] of a place [x, y, z] [m], whose height follows the Earth's curvature. */
function degreesOf([x, y, z], { latitude, longitude, height, heading }) {
  const turn = ((90 - heading) * Math.PI) / 180;
  const east = x * Math.cos(turn) - y * Math.sin(turn), north = x * Math.sin(turn) + y * Math.cos(turn);
  const [phi, lambda] = [latitude, longitude].map((degrees) => (degrees * Math.PI) / 180);
  const up = height + z - (x * x + y * y) / (2 * AXIS); // over the plane from which the Earth curves away
  return geodetic(centered(east, north, up, phi, lambda)).map((angle) => (angle * 180) / Math.PI);
}

const curvature = (phi) => AXIS / Math.sqrt(1 - ECCENTRICITY * Math.sin(phi) ** 2);

/** Earth-centered coordinates [m] of East, North and Up from a point of the ellipsoid. */
function centered(east, north, up, phi, lambda) {
  const [s, c, sl, cl] = [Math.sin(phi), Math.cos(phi), Math.sin(lambda), Math.cos(lambda)];
  const n = curvature(phi);
  const outward = (n + up) * c - north * s; // from the Earth's axis
  return [outward * cl - east * sl, outward * sl + east * cl, (n * (1 - ECCENTRICITY) + up) * s + north * c];
}

/** [latitude, longitude] [rad] of Earth-centered coordinates [m]. */
function geodetic([x, y, z]) {
  const p = Math.hypot(x, y);
  let phi = Math.atan2(z, p * (1 - ECCENTRICITY)), height = 0;
  for (let round = 0; round < ROUNDS; round++) {
    const n = curvature(phi);
    height = p * Math.cos(phi) + z * Math.sin(phi) - AXIS ** 2 / n;
    phi = Math.atan2(z, p * (1 - (ECCENTRICITY * n) / (n + height)));
  }
  return [phi, Math.atan2(y, x)];
}
