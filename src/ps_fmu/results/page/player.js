// Plays the motions of a mechanism side by side: one clock, one camera, one exaggeration for all.

const MOTIONS = ["basePosition", "baseRotation", "payloadPosition", "payloadRotation"];
const NOMINAL = ["nominalPosition", "nominalOrientation"];
const SPEEDS = [0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30, 100];
/** The largest exaggerated motion at the start, as a share of the base's radius. */
const SHARE = 0.25;

/** A run of the mechanism: its state at any instant, between the instants that are known on a straight line. */
class Motion {
  constructor(packed) {
    this.label = packed.label;
    this.time = new Axis(packed.time);
    this.columns = Object.fromEntries([...MOTIONS, ...NOMINAL].map((name) => [name, decode(packed[name])]));
  }

  at(time) {
    const place = this.time.find(time);
    const next = Math.min(place + 1, this.time.count - 1);
    const span = this.time.at(next) - this.time.at(place);
    const share = span > 0 ? Math.min(Math.max((time - this.time.at(place)) / span, 0), 1) : 0;
    return Object.fromEntries(
      Object.entries(this.columns).map(([name, column]) => {
        const [from, to] = column.length === 3 ? [0, 0] : [3 * place, 3 * next];
        return [name, [0, 1, 2].map((k) => column[from + k] + share * (column[to + k] - column[from + k]))];
      }),
    );
  }

  /** Largest rotation [rad] or displacement over a length, of base and payload. */
  largest(length) {
    return Math.max(...MOTIONS.map((name) => {
      const most = this.columns[name].reduce((found, value) => Math.max(found, Math.abs(value)), 0);
      return name.endsWith("Position") ? most / length : most;
    }));
  }
}

class Player {
  constructor(packed, section) {
    this.mechanism = new Mechanism(packed);
    this.motions = packed.motions.map((motion) => new Motion(motion));
    this.end = Math.max(...this.motions.map((motion) => motion.time.last));
    const most = Math.max(...this.motions.map((motion) => motion.largest(this.mechanism.radius)));
    this.gain = most > 0 ? Math.max(roundStep(SHARE / most), 1) : 1;
    this.mostGain = 10 * this.gain;
    Object.assign(this, { time: 0, playing: false, speed: this.end > 60 ? 10 : 1, printWidth: null });
    const height = this.motions[0].columns.nominalPosition[2];
    this.camera = new Camera([0, 0, 0.75 * height], 5.5 * this.mechanism.radius);
    this.stage = section.querySelector(".stage");
    this.canvases = this.motions.map((motion) => this.makeCanvas(motion));
    this.addControls(section.querySelector(".bar"));
    this.resize(null);
  }

  makeCanvas(motion) {
    const canvas = make("canvas", { role: "img", "aria-label": `Mechanism, ${motion.label}` });
    const box = make("div", {}, make("h3", {}, motion.label), canvas);
    this.stage.append(box);
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.pointerType !== "touch" && event.buttons) this.look(() => this.camera.rotate(event.movementX, event.movementY));
    });
    canvas.addEventListener("wheel", (event) => {
      if (!event.ctrlKey && !event.metaKey) return;
      event.preventDefault();
      this.look(() => this.camera.zoom(event.deltaY > 0 ? 1 / WHEEL_ZOOM : WHEEL_ZOOM));
    }, { passive: false });
    listenToFingers(canvas, {
      move: (dx, dy) => this.look(() => this.camera.rotate(dx, dy)),
      pinch: (ratio) => this.look(() => this.camera.zoom(ratio)),
    });
    return canvas;
  }

  addControls(bar) {
    this.button = makeButton("\u25b6 Play", "Play or pause the run", () => this.toggle());
    this.slider = makeSlider(0, this.end, this.end / 2000, 0, (value) => this.seek(value));
    this.clock = make("output", {}, "");
    const speed = make("select", {}, ...SPEEDS.map((value) => make("option", { value }, `${value} \u00d7`)));
    speed.value = String(this.speed);
    speed.addEventListener("change", () => { this.speed = Number(speed.value); });
    const top = Math.log10(this.mostGain);
    this.gainText = make("output", {}, "");
    const gain = makeSlider(0, top, top / 200 || 1, Math.log10(this.gain), (value) => {
      this.gain = 10 ** value;
      this.draw();
    });
    const view = makeButton("Reset view", "Look from where it was at first", () => this.look(() => this.camera.reset()));
    bar.append(
      this.button, make("label", {}, "time", this.slider), this.clock, make("label", {}, "speed", speed),
      make("label", {}, "motion exaggerated", gain), this.gainText, view,
      make("span", { class: "span" }, swatch("y"), "coarse legs"), make("span", { class: "span" }, swatch("z"), "fine legs"),
    );
  }

  toggle() {
    this.playing = !this.playing;
    this.button.textContent = this.playing ? "\u275a\u275a Pause" : "\u25b6 Play";
    if (!this.playing) return;
    if (this.time >= this.end) this.time = 0;
    let before = performance.now();
    const advance = (now) => {
      if (!this.playing) return;
      this.time += (this.speed * Math.max(now - before, 0)) / 1000;
      before = now;
      if (this.time >= this.end) {
        this.time = this.end;
        this.toggle();
      } else requestAnimationFrame(advance);
      this.draw();
    };
    requestAnimationFrame(advance);
  }

  seek(time) {
    this.time = time;
    this.draw();
  }

  look(change) {
    change();
    this.draw();
  }

  resize(printWidth) {
    const columns = printWidth || this.stage.clientWidth > 640 ? Math.min(this.motions.length, 2) : 1;
    this.stage.style.display = "grid";
    this.stage.style.gap = "1rem";
    this.stage.style.gridTemplateColumns = `repeat(${columns}, minmax(0, 1fr))`;
    this.width = Math.max((printWidth || this.stage.clientWidth) / columns - 12, 200);
    this.height = Math.min(this.width, 460);
    this.contexts = this.canvases.map((canvas) => fitCanvas(canvas, this.width, this.height));
    this.draw();
  }

  draw() {
    this.motions.forEach((motion, k) => {
      const parts = this.mechanism.pose(motion.at(this.time), this.gain);
      drawParts(this.contexts[k], parts, this.camera, this.width, this.height);
    });
    this.slider.value = String(this.time);
    this.clock.textContent = `${this.time.toFixed(2)} s`;
    this.gainText.textContent = `\u00d7 ${formatNumber(this.gain, 2)}`;
  }
}

function makeSlider(min, max, step, value, change) {
  const slider = make("input", { type: "range", min, max, step });
  slider.value = String(value);
  slider.addEventListener("input", () => change(Number(slider.value)));
  return slider;
}
