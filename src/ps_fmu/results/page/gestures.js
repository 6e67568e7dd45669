// What pointers, wheel and keys do on a chart: they change the range of its linked axis.

const WHEEL_ZOOM = 1.25;

/** `over` is the element of the plotting area, `valueAt` the axis value at a distance from its left edge, px. */
function listenOnChart(over, link, valueAt) {
  const left = (event) => event.clientX - over.getBoundingClientRect().left;

  // A plain wheel scrolls the page; with Ctrl, which is also what a pinch on a touchpad sends, it zooms.
  over.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    link.zoom(event.deltaY > 0 ? WHEEL_ZOOM : 1 / WHEEL_ZOOM, valueAt(left(event)));
  }, { passive: false });
  over.addEventListener("dblclick", () => link.reset());
  listenToFingers(over, {
    move: (dx) => link.move(-dx / over.clientWidth),
    pinch: (ratio, clientX) => link.zoom(1 / ratio, valueAt(clientX - over.getBoundingClientRect().left)),
  });
}

/** Buttons of a bar that zoom `what` is shown, and move along its axis if it has one. */
function makeZoomButtons(what, link, moves) {
  return [
    makeButton("+", `Zoom in (+; also: drag across ${what}, Ctrl and wheel, two fingers)`, () => link.zoom(0.5)),
    makeButton("\u2212", "Zoom out (-)", () => link.zoom(2)),
    ...(moves ? [
      makeButton("\u25c0", "Move left (arrow key)", () => link.move(-0.25)),
      makeButton("\u25b6", "Move right (arrow key)", () => link.move(0.25)),
    ] : []),
    makeButton("All", "Show everything (0, or double click)", () => link.reset()),
  ];
}

/** Keys on a focused element. */
function listenToKeys(element, link) {
  const actions = {
    "+": () => link.zoom(0.5), "=": () => link.zoom(0.5), "-": () => link.zoom(2), 0: () => link.reset(),
    ArrowLeft: () => link.move(-0.25), ArrowRight: () => link.move(0.25),
  };
  element.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || !actions[event.key]) return;
    event.preventDefault();
    actions[event.key]();
  });
}

/** One finger moves (dx, dy), two pinch (ratio of their distances, their middle); mouse and pen are left alone. */
function listenToFingers(element, { move, pinch }) {
  const fingers = new Map();
  const spread = () => {
    const [a, b] = fingers.values();
    return { distance: Math.hypot(a.x - b.x, a.y - b.y), middle: (a.x + b.x) / 2 };
  };
  element.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "touch") fingers.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  element.addEventListener("pointermove", (event) => {
    const finger = fingers.get(event.pointerId);
    if (!finger) return;
    const before = fingers.size === 2 ? spread() : null;
    const [dx, dy] = [event.clientX - finger.x, event.clientY - finger.y];
    Object.assign(finger, { x: event.clientX, y: event.clientY });
    if (!before) move(dx, dy);
    else if (before.distance > 0) pinch(spread().distance / before.distance, before.middle);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    element.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
}
