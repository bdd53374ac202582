// Latitude and longitude of places of a map: the twin of `Georeference.geodetic` in tools/files/geo.py.

const AXIS = 6378137, FLATTENING = 1 / 298.257223563; // of the WGS84 ellipsoid [m]
const ECCENTRICITY = FLATTENING * (2 - FLATTENING); // squared

/** [latitude, longitude] [deg] of a place [x, y, z] [m], whose height follows the Earth's curvature. */
function degreesOf([x, y, z], { latitude, longitude, height, heading }) {
  const [turn, phi, lambda] = [90 - heading, latitude, longitude].map((degrees) => (degrees * Math.PI) / 180);
  const east = x * Math.cos(turn) - y * Math.sin(turn), north = x * Math.sin(turn) + y * Math.cos(turn);
  const up = height + z - (x * x + y * y) / (2 * AXIS); // over the plane from which the Earth curves away
  const [s, c] = [Math.sin(phi), Math.cos(phi)], curvature = AXIS / Math.sqrt(1 - ECCENTRICITY * s ** 2);
  const outward = (curvature + up) * c - north * s, pole = (curvature * (1 - ECCENTRICITY) + up) * s + north * c;
  const far = Math.hypot(outward, east), narrow = AXIS * (1 - FLATTENING);
  const reduced = Math.atan2(pole * AXIS, far * narrow); // Bowring (1976)
  const risen = pole + (ECCENTRICITY / (1 - ECCENTRICITY)) * narrow * Math.sin(reduced) ** 3;
  const found = Math.atan2(risen, far - ECCENTRICITY * AXIS * Math.cos(reduced) ** 3);
  const around = Math.atan2(Math.sin(lambda) * outward + Math.cos(lambda) * east, Math.cos(lambda) * outward - Math.sin(lambda) * east);
  return [found, around].map((angle) => (angle * 180) / Math.PI);
}
