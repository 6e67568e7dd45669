// The range of an axis that several charts share: whoever changes it changes all of them, once a frame.

/** Fewest values of the axis that a range shows. */
const CLOSEST = 8;

class LinkedAxis {
  constructor(axis, announce) {
    this.axis = axis;
    this.announce = announce;
    this.views = [];
    this.pending = false;
    this.min = axis.first;
    this.max = axis.last;
  }

  // Zooming and moving are done where the axis is straight.
  straight(value) { return this.axis.logarithmic ? Math.log10(value) : value; }
  bent(value) { return this.axis.logarithmic ? 10 ** value : value; }

  /** What a chart shows: about an axis of a single value, too. */
  get range() {
    if (this.min < this.max) return [this.min, this.max];
    return this.axis.logarithmic ? [this.min / 2, this.max * 2] : [this.min - 1, this.max + 1];
  }

  reset() { this.set(this.axis.first, this.axis.last); }

  set(min, max) {
    const whole = [this.straight(this.axis.first), this.straight(this.axis.last)];
    const wanted = this.straight(max) - this.straight(min);
    const span = Math.min(Math.max(wanted, this.shortest(min, max)), whole[1] - whole[0]);
    const centre = (this.straight(min) + this.straight(max)) / 2;
    const begin = Math.min(Math.max(centre - span / 2, whole[0]), whole[1] - span);
    this.min = this.bent(begin);
    this.max = this.bent(begin + span);
    this.draw();
  }

  /** Shortest span about the middle of a range, on the straight axis. */
  shortest(min, max) {
    const place = this.axis.find(this.bent((this.straight(min) + this.straight(max)) / 2));
    const first = Math.max(0, Math.min(place, this.axis.count - 1 - CLOSEST));
    const last = Math.min(first + CLOSEST, this.axis.count - 1);
    return this.straight(this.axis.at(last)) - this.straight(this.axis.at(first));
  }

  /** Show `factor` times as much, keeping a value where it is. */
  zoom(factor, value = this.bent((this.straight(this.min) + this.straight(this.max)) / 2)) {
    const [low, at, high] = [this.min, value, this.max].map((each) => this.straight(each));
    this.set(this.bent(at - (at - low) * factor), this.bent(at + (high - at) * factor));
  }

  /** Move by a share of what is shown. */
  move(share) {
    const [low, high] = [this.straight(this.min), this.straight(this.max)];
    const whole = [this.straight(this.axis.first), this.straight(this.axis.last)];
    const way = Math.min(Math.max(share * (high - low), whole[0] - low), whole[1] - high);
    this.set(this.bent(low + way), this.bent(high + way));
  }

  draw() {
    if (this.pending) return;
    this.pending = true;
    requestAnimationFrame(() => {
      this.pending = false;
      for (const view of this.views) view.update();
      this.announce(this);
    });
  }
}
