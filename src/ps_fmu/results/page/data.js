// Reads the data of the page: a JSON element whose arrays are base64 of little-endian float32.

/** The bytes behind a base64 text. */
function decodeBytes(text) {
  const bytes = atob(text);
  const buffer = new Uint8Array(bytes.length);
  for (let i = 0; i < bytes.length; i++) buffer[i] = bytes.charCodeAt(i);
  return buffer;
}

/** The numbers behind a base64 text. */
function decode(text) {
  return new Float32Array(decodeBytes(text).buffer);
}

/** A horizontal axis: values by place, and places by value. Equally spaced ones are computed in double precision. */
class Axis {
  constructor(packed) {
    Object.assign(this, { label: packed.label, unit: packed.unit, logarithmic: packed.logarithmic });
    this.count = packed.count;
    this.values = packed.values === undefined ? null : decode(packed.values);
    this.start = packed.start;
    this.step = packed.step;
  }

  at(place) {
    return this.values ? this.values[place] : this.start + place * this.step;
  }

  get first() { return this.at(0); }
  get last() { return this.at(this.count - 1); }

  /** Place of the last value that is not above the given one; 0 if all are. */
  find(value) {
    if (!this.values) {
      const place = Math.floor((value - this.start) / (this.step || 1) + 1e-9);
      return Math.min(Math.max(place, 0), this.count - 1);
    }
    let low = 0;
    let high = this.count - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.values[middle] <= value) low = middle;
      else high = middle - 1;
    }
    return low;
  }
}

function readData() {
  return JSON.parse(document.getElementById("data").textContent);
}
