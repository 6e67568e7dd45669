// Numbers and units as texts, and elements of the page. Texts enter the page as text, never as HTML.

const PREFIXES = { "-15": "f", "-12": "p", "-9": "n", "-6": "\u00b5", "-3": "m", 0: "", 3: "k", 6: "M" };
const PREFIXED = new Set(["m", "rad", "N", "N.m", "m/s", "rad/s", "m/s2", "rad/s2", "deg"]);
const RAISED = "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079";

/** An FMI unit as a label: rad2/Hz with a raised 2, N.m with a space, nothing for 1. */
function prettyUnit(unit) {
  if (unit === "1") return "";
  return unit.replaceAll(".", " ").replace(/\d/g, (digit) => RAISED[digit]);
}

/** Factor and label of the engineering prefix that suits a magnitude. */
function engineering(unit, magnitude) {
  if (!PREFIXED.has(unit) || !(magnitude > 0)) return { factor: 1, unit: prettyUnit(unit) };
  const exponent = Math.min(Math.max(3 * Math.floor(Math.log10(magnitude) / 3 + 1e-9), -15), 6);
  return { factor: 10 ** -exponent, unit: PREFIXES[exponent] + prettyUnit(unit) };
}

/** A number in so many digits; very large and very small ones as a power of ten. */
function formatNumber(value, digits = 4) {
  if (!Number.isFinite(value)) return "\u2013";
  const size = Math.abs(value);
  if (size !== 0 && (size < 1e-3 || size >= 1e6)) {
    const [mantissa, exponent] = value.toExponential(digits - 1).split("e");
    return `${String(Number(mantissa)).replace("-", "\u2212")}\u00b7${formatPower(Number(exponent))}`;
  }
  return String(Number(value.toPrecision(digits))).replace("-", "\u2212");
}

/** Ten to a whole power: 10 with raised digits. */
function formatPower(exponent) {
  const digits = String(Math.abs(exponent)).replace(/\d/g, (digit) => RAISED[digit]);
  return `10${exponent < 0 ? "\u207b" : ""}${digits}`;
}

/** A number with its unit. */
function formatQuantity(value, unit, digits = 4) {
  const scaled = engineering(unit, Math.abs(value));
  return `${formatNumber(value * scaled.factor, digits)} ${scaled.unit}`.trimEnd();
}

/** A new element with attributes and, in the end, children or texts. */
function make(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** A mark in one of the page's colours. */
function swatch(colour) {
  const mark = make("span", { class: "swatch" });
  mark.style.background = `var(--${colour})`;
  return mark;
}

/** A button of a bar. */
function makeButton(text, title, press) {
  const button = make("button", { type: "button", title }, text);
  button.addEventListener("click", () => press(button));
  return button;
}
