// Points of a plane with their hulls, x and y to the same scale.

const CLOUD_MARGIN = 46;
/** The smallest part of the plane that is shown, over all of it: labels of the axes have room for its digits. */
const CLOUD_CLOSEST = 1e-3;
/** A press that moves less, px, is a click. */
const SHORTEST_DRAG = 5;

/** A canvas fitted to its place and the screen's pixels; returns its context, scaled to CSS pixels. */
function fitCanvas(canvas, width, height) {
  const ratio = devicePixelRatio || 1;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return context;
}

class CloudView {
  /** `clouds` are decoded; `readout` takes the place under the pointer. */
  constructor(clouds, unit, stage, readout) {
    Object.assign(this, { clouds, unit, readout, stage, selected: null, pending: false });
    this.canvas = make("canvas", {
      role: "img", tabindex: "0", "aria-label": `Points: ${clouds.map((each) => each.label).join(", ")}`,
    });
    stage.append(this.canvas);
    const hulls = clouds.flatMap((cloud) => [...cloud.hull].map(Math.abs));
    this.whole = 1.08 * hulls.reduce((most, value) => Math.max(most, value), 0) || 1;
    Object.assign(this, { x: 0, y: 0, reach: this.whole });
    this.canvas.addEventListener("pointermove", (event) => this.read(event));
    this.canvas.addEventListener("pointerleave", () => { readout.textContent = ""; });
    listenOnCloud(this.canvas, this);
    this.resize(null);
  }

  resize(printWidth) {
    const columns = this.stage.clientWidth > 640 ? 2 : 1;
    const width = (printWidth || this.stage.clientWidth) / (printWidth ? 2 : columns) - 8;
    this.size = Math.max(Math.min(width, 460), 200);
    this.draw();
  }

  get inner() { return this.size - 2 * CLOUD_MARGIN; }
  across(x) { return this.size / 2 + ((x - this.x) / this.reach) * (this.inner / 2); }
  down(y) { return this.size / 2 - ((y - this.y) / this.reach) * (this.inner / 2); }

  /** The point of the plane under a place of the window. */
  under(clientX, clientY) {
    const box = this.canvas.getBoundingClientRect();
    const back = (pixels) => ((pixels - this.size / 2) / (this.inner / 2)) * this.reach;
    return [this.x + back(clientX - box.left), this.y - back(clientY - box.top)];
  }

  /** Show so much about a point, within what there is. */
  set(x, y, reach) {
    this.reach = Math.min(Math.max(reach, this.whole * CLOUD_CLOSEST), this.whole);
    const most = this.whole - this.reach;
    [this.x, this.y] = [x, y].map((value) => Math.min(Math.max(value, -most), most));
    this.drawSoon();
  }

  reset() { this.set(0, 0, this.whole); }

  /** Show `factor` times as much, keeping a point where it is. */
  zoom(factor, [x, y] = [this.x, this.y]) {
    const reach = Math.min(Math.max(this.reach * factor, this.whole * CLOUD_CLOSEST), this.whole);
    this.set(x + (this.x - x) * (reach / this.reach), y + (this.y - y) * (reach / this.reach), reach);
  }

  /** Move by shares of what is shown, to the right and up. */
  move(right, up = 0) { this.set(this.x + 2 * right * this.reach, this.y + 2 * up * this.reach, this.reach); }

  /** Show the square about two corners. */
  show([x1, y1], [x2, y2]) {
    this.set((x1 + x2) / 2, (y1 + y2) / 2, Math.max(Math.abs(x2 - x1), Math.abs(y2 - y1)) / 2);
  }

  drawSoon() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      this.draw();
    });
  }

  draw() {
    const context = fitCanvas(this.canvas, this.size, this.size);
    this.drawAxes(context);
    context.save();
    context.beginPath();
    context.rect(CLOUD_MARGIN, CLOUD_MARGIN, this.inner, this.inner);
    context.clip();
    for (const cloud of this.clouds) this.drawCloud(context, cloud);
    if (this.selected) this.drawSelected(context, ...this.selected);
    context.restore();
  }

  drawSelected(context, [x1, y1], [x2, y2]) {
    context.fillStyle = theme.faded("active", 0.2);
    context.fillRect(this.across(x1), this.down(y1), this.across(x2) - this.across(x1), this.down(y2) - this.down(y1));
  }

  drawCloud(context, { points, hull, colour }) {
    context.fillStyle = theme.faded(colour, 0.45);
    for (let i = 0; i < points.length; i += 2) {
      context.fillRect(this.across(points[i]) - 1, this.down(points[i + 1]) - 1, 2, 2);
    }
    context.strokeStyle = theme.colour(colour);
    context.lineWidth = 1.5;
    context.beginPath();
    for (let i = 0; i < hull.length; i += 2) context.lineTo(this.across(hull[i]), this.down(hull[i + 1]));
    context.closePath();
    context.stroke();
  }

  drawAxes(context) {
    const scaled = engineering(this.unit, this.reach);
    const step = roundStep((2 * this.reach * scaled.factor) / 5);
    const end = this.size - CLOUD_MARGIN;
    const farthest = (Math.max(Math.abs(this.x), Math.abs(this.y)) + this.reach) * scaled.factor;
    const digits = Math.max(3, Math.ceil(Math.log10(farthest / step)) + 1); // so that neighbours differ
    context.font = "12px system-ui";
    context.textAlign = "center";
    for (const value of listMultiples(this.x, this.reach, scaled.factor, step)) {
      const at = this.across(value / scaled.factor);
      context.fillStyle = theme.colour("grid");
      context.fillRect(at, CLOUD_MARGIN, 1, this.inner);
      context.fillStyle = theme.colour("text");
      context.fillText(formatNumber(value, digits), at, end + 16);
    }
    for (const value of listMultiples(this.y, this.reach, scaled.factor, step)) {
      const at = this.down(value / scaled.factor);
      context.fillStyle = theme.colour("grid");
      context.fillRect(CLOUD_MARGIN, at, this.inner, 1);
      context.fillStyle = theme.colour("text");
      context.fillText(formatNumber(value, digits), CLOUD_MARGIN - 22, at + 4);
    }
    context.fillText(`x (${scaled.unit})`, this.size / 2, this.size - 8);
    context.fillText(`y (${scaled.unit})`, CLOUD_MARGIN, CLOUD_MARGIN - 10);
  }

  read(event) {
    const [x, y] = this.under(event.clientX, event.clientY);
    const texts = [["x", x], ["y", y], ["distance", Math.hypot(x, y)]];
    this.readout.textContent = texts.map(([name, value]) => `${name} ${formatQuantity(value, this.unit, 3)}`).join("   ");
  }
}

/** Multiples of `step` within what is shown, all in the scaled unit. */
function listMultiples(centre, reach, factor, step) {
  const first = Math.ceil(((centre - reach) * factor) / step - 1e-9);
  const last = Math.floor(((centre + reach) * factor) / step + 1e-9);
  return Array.from({ length: last - first + 1 }, (_, k) => (first + k) * step);
}

/** Wheel, drag, fingers, double click and keys on the canvas of a cloud, as on the charts. */
function listenOnCloud(canvas, view) {
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey && !event.metaKey) return;
    event.preventDefault();
    view.zoom(event.deltaY > 0 ? WHEEL_ZOOM : 1 / WHEEL_ZOOM, view.under(event.clientX, event.clientY));
  }, { passive: false });
  canvas.addEventListener("dblclick", () => view.reset());
  listenToKeys(canvas, view);
  canvas.addEventListener("keydown", (event) => {
    const up = { ArrowUp: 0.25, ArrowDown: -0.25 }[event.key];
    if (!up || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    view.move(0, up);
  });
  listenToFingers(canvas, {
    move: (dx, dy) => view.move(-dx / view.inner, dy / view.inner),
    pinch: (ratio) => view.zoom(1 / ratio),
  });
  listenToSelection(canvas, view);
}

/** A drag with mouse or pen selects what to show. */
function listenToSelection(canvas, view) {
  let start = null;
  canvas.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "touch" || event.button !== 0) return;
    start = { x: event.clientX, y: event.clientY };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!start) return;
    view.selected = [view.under(start.x, start.y), view.under(event.clientX, event.clientY)];
    view.drawSoon();
  });
  canvas.addEventListener("pointerup", (event) => {
    if (!start) return;
    const long = Math.hypot(event.clientX - start.x, event.clientY - start.y) > SHORTEST_DRAG;
    if (long) view.show(view.under(start.x, start.y), view.under(event.clientX, event.clientY));
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, () => {
      start = view.selected = null;
      view.drawSoon();
    });
  }
}

/** The next larger of 1, 2, 5 times a power of ten. */
function roundStep(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((step) => step * power >= value * (1 - 1e-9));
}

/** All clouds of a group in one view, and the last alone, enlarged. */
function makeClouds(packed, section) {
  const clouds = packed.clouds.map((cloud) => ({ ...cloud, points: decode(cloud.points), hull: decode(cloud.hull) }));
  const readout = make("span", { class: "span" });
  const legend = clouds.map((cloud) => make("span", { class: "span" }, swatch(cloud.colour), cloud.label));
  const stage = section.querySelector(".stage");
  const views = [new CloudView(clouds, packed.unit, stage, readout)];
  if (clouds.length > 1) views.push(new CloudView(clouds.slice(-1), packed.unit, stage, readout));
  const all = {
    zoom: (factor) => views.forEach((view) => view.zoom(factor)), reset: () => views.forEach((view) => view.reset()),
  };
  section.querySelector(".bar").append(
    ...legend,
    ...makeZoomButtons("the points", all, false),
    readout,
  );
  return views;
}
