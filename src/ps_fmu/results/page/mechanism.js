// The mechanism at an instant: base plate, six legs, platform with its telescope; drawn from the farthest face on.

const TUBE_SIDES = 16;
const LIGHT = times(1 / Math.hypot(1, -1, 2), [1, -1, 2]);

/** Rows of three numbers. */
function rowsOf(numbers) {
  return Array.from({ length: numbers.length / 3 }, (_, k) => [...numbers.slice(3 * k, 3 * k + 3)]);
}

/** The bodies of the mechanism, each in its own frame; sizes follow the joints. */
class Mechanism {
  constructor(packed) {
    this.baseJoints = rowsOf(decode(packed.baseJoints));
    this.platformJoints = rowsOf(decode(packed.platformJoints));
    this.radius = Math.max(...this.baseJoints.map((joint) => Math.hypot(joint[0], joint[1])));
    const inner = Math.max(...this.platformJoints.map((joint) => Math.hypot(joint[0], joint[1])));
    const thin = 0.06 * this.radius;
    this.base = prism(ring(1.15 * this.radius, 24, 0, -2 * thin), 2 * thin);
    this.platform = prism(ring(1.15 * inner, 24, 0, 0), thin);
    this.tube = prism(ring(0.62 * inner, TUBE_SIDES, 0, thin), 1.5 * inner);
    this.sightFrom = [0, 0, thin + 1.5 * inner];
    this.sightTo = [0, 0, 3.4 * inner];
  }

  /** Faces, legs and line of sight at an instant of a motion, the small motions exaggerated. */
  pose(instant, gain) {
    const onBase = (point) => add(turn(times(gain, instant.baseRotation), point), times(gain, instant.basePosition));
    const onPayload = (point) =>
      add(
        add(orient(instant.nominalOrientation, turn(times(gain, instant.payloadRotation), point)), instant.nominalPosition),
        times(gain, instant.payloadPosition),
      );
    const still = (point) => add(orient(instant.nominalOrientation, point), instant.nominalPosition);
    return [
      ...faces(this.base, onBase, "soft"),
      ...faces(this.platform, onPayload, "active"),
      ...faces(this.tube, onPayload, "grid"),
      ...this.baseJoints.map((joint, k) => ({
        leg: [onBase(joint), onPayload(this.platformJoints[k])], colour: k < 3 ? "y" : "z",
      })),
      { dashed: [onPayload(this.sightFrom), onPayload(this.sightTo)], colour: "text" },
      { dashed: [still(this.sightFrom), still(this.sightTo)], colour: "reference" },
    ];
  }
}

function ring(radius, sides, phase, height) {
  return Array.from({ length: sides }, (_, k) => {
    const angle = phase + (2 * Math.PI * k) / sides;
    return [radius * Math.cos(angle), radius * Math.sin(angle), height];
  });
}

/** Faces of a prism over a ring of points; corners run so that normals point outwards. */
function prism(bottom, height) {
  const top = bottom.map((point) => add(point, [0, 0, height]));
  const sides = bottom.map((point, k) => {
    const next = (k + 1) % bottom.length;
    return [point, bottom[next], top[next], top[k]];
  });
  return [[...bottom].reverse(), top, ...sides];
}

function faces(body, move, colour) {
  return body.map((face) => ({ face: face.map(move), colour }));
}

/** Draw posed parts as a camera sees them. */
function drawParts(context, parts, camera, width, height) {
  const palette = new Map();
  const colour = (name) => palette.get(name) ?? palette.set(name, theme.colour(name)).get(name);
  const seen = parts.map((part) => {
    const points = part.face || part.leg || part.dashed;
    const placed = points.map((point) => camera.project(point, width, height));
    return { part, points, placed, depth: placed.reduce((sum, point) => sum + point.depth, 0) / placed.length };
  });
  seen.sort((a, b) => b.depth - a.depth);
  context.clearRect(0, 0, width, height);
  for (const { part, points, placed } of seen) {
    if (part.face) drawFace(context, points, placed, colour(part.colour));
    else drawLine(context, placed, colour(part.colour), part, width);
  }
}

function drawFace(context, points, placed, colour) {
  // Faces that look away are hidden by those that do not.
  const area = placed.reduce((sum, a, k) => {
    const b = placed[(k + 1) % placed.length];
    return sum + a.x * b.y - b.x * a.y;
  }, 0);
  if (area >= 0) return;
  const normal = cross(subtract(points[1], points[0]), subtract(points[2], points[1]));
  const brightness = 0.78 + (0.22 * dot(normal, LIGHT)) / (Math.hypot(...normal) || 1);
  trace(context, placed);
  context.closePath();
  context.fillStyle = shade(colour, brightness);
  context.fill();
  context.strokeStyle = shade(colour, 0.8 * brightness);
  context.lineWidth = 0.7;
  context.stroke();
}

function drawLine(context, placed, colour, part, width) {
  const thick = Math.max(width / 90, 2.5);
  context.strokeStyle = colour;
  context.lineCap = "round";
  context.setLineDash(part.dashed ? [5, 5] : []);
  context.lineWidth = part.dashed ? 1.2 : 0.55 * thick;
  trace(context, placed);
  context.stroke();
  context.setLineDash([]);
  if (part.dashed) return;
  // The lower, thicker half: the actuator.
  const [foot, head] = placed;
  const half = { x: (foot.x + head.x) / 2, y: (foot.y + head.y) / 2 };
  context.lineWidth = thick;
  trace(context, [foot, half]);
  context.stroke();
}

function trace(context, placed) {
  context.beginPath();
  placed.forEach((point) => context.lineTo(point.x, point.y));
}

/** A colour #rrggbb, darker or lighter. */
function shade(colour, factor) {
  const parts = [1, 3, 5].map((k) => Math.min(255, Math.round(factor * parseInt(colour.slice(k, k + 2), 16))));
  return `rgb(${parts.join(",")})`;
}
