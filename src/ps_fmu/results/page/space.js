// Points and rotations in space, and the camera that looks at them. Vectors are lists of three numbers.

const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const times = (factor, a) => [factor * a[0], factor * a[1], factor * a[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const middle = (points) => times(1 / points.length, points.reduce(add, [0, 0, 0]));

/** A vector turned by a rotation vector (Rodrigues): exaggerated motions are large, and bodies have to stay rigid. */
function turn(rotation, vector) {
  const angle = Math.hypot(...rotation);
  if (angle < 1e-12) return vector;
  const n = times(1 / angle, rotation);
  const along = times(dot(n, vector) * (1 - Math.cos(angle)), n);
  return add(add(times(Math.cos(angle), vector), times(Math.sin(angle), cross(n, vector))), along);
}

/** A vector of P in axes of B at roll, pitch, yaw: R = Rz Ry Rx. */
function orient([roll, pitch, yaw], vector) {
  return turn([0, 0, yaw], turn([0, pitch, 0], turn([roll, 0, 0], vector)));
}

/** A camera that circles about a target, z upwards on the screen. */
class Camera {
  constructor(target, distance) {
    Object.assign(this, { target, distance });
    this.reset();
  }

  reset() {
    this.azimuth = -0.9;
    this.elevation = 0.4;
    this.magnification = 1;
  }

  rotate(dx, dy) {
    this.azimuth -= 0.01 * dx;
    this.elevation = Math.min(Math.max(this.elevation + 0.01 * dy, -1.5), 1.5);
  }

  zoom(ratio) {
    this.magnification = Math.min(Math.max(this.magnification * ratio, 0.3), 8);
  }

  /** Place on a canvas of width and height, and depth: larger is farther. */
  project(point, width, height) {
    const [x, y, z] = subtract(point, this.target);
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    const right = -sa * x + ca * y;
    const toward = ca * x + sa * y;
    const up = ce * z - se * toward;
    const depth = this.distance - (ce * toward + se * z);
    // A point behind the camera, far out in an exaggerated motion, must not flip over.
    const scale = (1.3 * this.magnification * Math.min(width, height)) / Math.max(depth, 0.1 * this.distance);
    return { x: width / 2 + scale * right, y: height / 2 - scale * up, depth };
  }
}
