// Colours of the page for what is drawn on canvases, and word of when they change.

const theme = {
  listeners: [],

  /** The value of a colour of page.css: "text", "passive". */
  colour(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
  },

  /** The same with an opacity from 0 to 1. */
  faded(name, opacity) {
    return theme.colour(name) + Math.round(255 * opacity).toString(16).padStart(2, "0");
  },

  changed() {
    for (const listener of theme.listeners) listener();
  },
};

/** Width of the text on a printed page, A4 with the browser's margins, px. */
const PRINT_WIDTH = 680;

/** Watch the switch, the system's setting, and the printer; `resize` fits all drawings to a width, or to the page. */
function watchTheme(resize) {
  document.getElementById("theme").addEventListener("change", theme.changed);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", theme.changed);
  addEventListener("beforeprint", () => {
    document.documentElement.dataset.printing = "yes";
    theme.changed();
    resize(PRINT_WIDTH);
  });
  addEventListener("afterprint", () => {
    delete document.documentElement.dataset.printing;
    theme.changed();
    resize(null);
  });
}
