// A camera that turns about a point. Matrices are relative to that point, so that a map of kilometers keeps its millimeters.

const FIELD = Math.PI / 4; // of view, from bottom to top [rad]
const STEEPEST = Math.PI / 2;
const NOTHING = [[-5, -5, -5], [5, 5, 5]]; // corners of what is seen while there is nothing [m]

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const sum = (a, b, factor = 1) => a.map((value, axis) => value + factor * b[axis]);
const minus = (a, b) => sum(a, b, -1);
const lengthOf = (a) => Math.hypot(...a);

class Camera {
  constructor() {
    this.width = this.height = 1; // of the picture [pixels of the page]
    this.cover(NOTHING, NOTHING);
    this.reset();
  }

  /** What there is to see, without a movement of the camera; between the corners `middle` [m] is most of it: strays aside. */
  cover(extent, middle) {
    this.center = sum(...middle).map((value) => value / 2);
    this.reach = Math.max(lengthOf(minus(...middle)) / 2, 0.1); // of most of the map about its center [m]
    this.extent = Math.max(this.reach, ...extent.map((corner) => lengthOf(minus(corner, this.center)))) + lengthOf(minus(...extent));
  }

  /** Look from the south and above. */
  reset() {
    this.target = [...this.center];
    this.distance = 1.8 * this.reach * Math.max(1, this.height / this.width);
    this.azimuth = 0.5; // where it looks, clockwise from y [rad]
    this.elevation = 0.75; // of the camera over the target [rad]
  }

  fromAbove() {
    this.azimuth = 0;
    this.elevation = STEEPEST;
  }

  turn(right, down) {
    this.azimuth = (this.azimuth + right) % (2 * Math.PI);
    this.elevation = Math.max(-STEEPEST, Math.min(STEEPEST, this.elevation + down));
  }

  /** Move what is seen by so many pixels. */
  pan(right, down) {
    const { right: r, up } = this.axes(), size = this.pixel();
    this.target = sum(sum(this.target, r, -right * size), up, down * size);
  }

  /** Zoom by a factor, toward a pixel that stays where it is. */
  zoom(factor, x = this.width / 2, y = this.height / 2) {
    const { right, up } = this.axes();
    const kept = (1 - 1 / factor) * this.pixel();
    this.target = sum(sum(this.target, right, kept * (x - this.width / 2)), up, kept * (this.height / 2 - y));
    this.distance = Math.max(1e-3 * this.reach, Math.min(20 * this.reach, this.distance / factor));
  }

  lookAt(place, distance = this.distance) {
    this.target = [...place];
    this.distance = distance;
  }

  /** Edge of a pixel at the target [m]. */
  pixel() {
    return (2 * this.distance * Math.tan(FIELD / 2)) / this.height;
  }

  axes() {
    const [s, c, se, ce] = [this.azimuth, this.elevation].flatMap((angle) => [Math.sin(angle), Math.cos(angle)]);
    return { right: [c, -s, 0], up: [s * se, c * se, ce], ahead: [s * ce, c * ce, -se] };
  }

  /** a and b of a depth of WebGL's clip space, which is a + b / distance. */
  planes() {
    const beyond = this.extent + lengthOf(minus(this.target, this.center));
    const far = this.distance + beyond, near = Math.max(this.distance - beyond, far * 5e-4);
    return [(far + near) / (far - near), (-2 * far * near) / (far - near)];
  }

  /** From places less the target [m] to WebGL's clip space, column by column. */
  matrix() {
    const { right, up, ahead } = this.axes();
    const fy = 1 / Math.tan(FIELD / 2), fx = (fy * this.height) / this.width;
    const [a, b] = this.planes();
    const columns = [0, 1, 2].map((k) => [fx * right[k], fy * up[k], a * ahead[k], ahead[k]]);
    return new Float32Array([...columns, [0, 0, a * this.distance + b, this.distance]].flat());
  }

  /** Where a place [m] is seen: [x, y] [pixels] and how far ahead it is [m]; behind the camera, that is negative. */
  project(place) {
    const { right, up, ahead } = this.axes();
    const away = minus(place, this.target);
    const depth = dot(away, ahead) + this.distance;
    const scale = this.height / (2 * Math.tan(FIELD / 2) * depth);
    return [this.width / 2 + scale * dot(away, right), this.height / 2 - scale * dot(away, up), depth];
  }
}
