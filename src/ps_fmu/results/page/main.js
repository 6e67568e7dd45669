// Fills the sections of the page from its data, and keeps them fitted to the window.

/** Charts of a group with the bar that shows their curves and moves their common axis. */
function makeGroup(packed, section, key) {
  const span = make("span", { class: "span" });
  const link = new LinkedAxis(new Axis(packed.axis), ({ min, max, axis }) => {
    span.textContent = `${formatNumber(min, 6)} to ${formatNumber(max, 6)} ${prettyUnit(axis.unit)}`;
  });
  link.key = key;
  const grid = section.querySelector(".grid");
  Object.assign(link, { columns: packed.columns, shaded: packed.shaded, marked: packed.marked });
  grid.style.setProperty("--columns", link.columns);
  grid.classList.toggle("narrow", link.columns > 1);
  // A small curve is flat beside a large one: a chart of its own has its own scale.
  const alone = (chart) => ({
    ...chart,
    title: `${chart.title}, ${packed.alone} alone`,
    curves: chart.curves.filter(({ label }) => label === packed.alone),
  });
  const charts = packed.charts.flatMap((chart) => (packed.alone ? [chart, alone(chart)] : [chart]));
  link.views = charts.map((chart) => {
    const element = make("div", { class: "chart", tabindex: "0" });
    grid.append(element);
    listenToKeys(element, link);
    return new LineChart(chart, link, element);
  });
  const shades = packed.shaded.map(({ label, colour, opacity }) => {
    const mark = swatch(colour);
    mark.style.opacity = opacity;
    return make("span", { class: "span" }, mark, label);
  });
  section.querySelector(".bar").append(
    ...shades,
    ...makeToggles(packed, link),
    ...makeZoomButtons("a chart", link, true),
    span,
  );
  link.announce(link);
  return link.views;
}

/** A button for each curve that shows and hides it in all charts of the group. */
function makeToggles(packed, link) {
  const curves = new Map(packed.charts.flatMap((chart) => chart.curves.map((curve) => [curve.label, curve.colour])));
  return [...curves].map(([label, colour]) => {
    const toggle = makeButton(label, "Show or hide", (button) => {
      const shown = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", String(shown));
      for (const view of link.views) view.show(label, shown);
    });
    toggle.classList.add("curve");
    toggle.setAttribute("aria-pressed", "true");
    toggle.prepend(swatch(colour));
    return toggle;
  });
}

function start() {
  const data = readData();
  const drawings = [
    ...data.waterfalls.flatMap((each, k) => makeWaterfall(each, document.querySelector(`[data-waterfall="${k}"]`))),
    ...data.charts.flatMap((group, k) => makeGroup(group, document.querySelector(`[data-group="${k}"]`), `group-${k}`)),
    ...data.clouds.flatMap((group, k) => makeClouds(group, document.querySelector(`[data-cloud="${k}"]`))),
  ];
  if (data.cases) drawings.push(new CaseExplorer(data.cases, document.querySelector(".cases")));
  if (data.mechanism) drawings.push(new Player(data.mechanism, document.querySelector(".mechanism")));
  const resize = (printWidth) => drawings.forEach((drawing) => drawing.resize(printWidth));
  theme.listeners.push(() => drawings.forEach((drawing) => (drawing.plot ? drawing.plot.redraw() : drawing.draw())));
  watchTheme(resize);
  let width = innerWidth;
  addEventListener("resize", () => {
    // On a phone the address bar changes the height alone while one scrolls.
    if (innerWidth !== width) resize(null);
    width = innerWidth;
  });
}

start();
