// The cases of a study: choose two columns, point at a case, read its command; sort and filter the table.

const MOST_LISTED = 100;
const STRONGEST = 12;

class CaseExplorer {
  constructor(packed, section) {
    const open = (column) => ({ ...column, numbers: decode(column.values) });
    this.packed = packed;
    this.cases = decode(packed.cases);
    this.parameters = packed.parameters.map(open);
    this.metrics = packed.metrics.map(open);
    this.columns = [...this.parameters, ...this.metrics];
    this.failed = new Map(packed.failed);
    this.pinned = null;
    this.sort = { key: "metric", down: true };
    this.x = this.parameters[this.strongest(this.metrics[0])];
    this.y = this.metrics[0];
    this.build(section);
    this.chooseColumns();
  }

  build(section) {
    const [stage, list] = [section.querySelector(".grid"), section.querySelector(".list")];
    const figure = (title) => {
      const element = make("div", { class: "chart" });
      const plot = make("div", { class: "plot" });
      element.append(make("h3", {}, title), plot);
      stage.append(element);
      return plot;
    };
    stage.style.setProperty("--columns", 2);
    this.readout = make("div", { class: "readout", role: "status" });
    section.querySelector(".bar").append(
      ...this.makeSelectors(),
      makeButton("Cumulative", "Show the distribution as the share of the cases up to each value", (button) => {
        this.distribution.cumulative = !this.distribution.cumulative;
        button.textContent = this.distribution.cumulative ? "Histogram" : "Cumulative";
        this.distribution.make();
      }),
    );
    stage.before(this.readout);
    const chosen = () => ({ x: this.x, y: this.y });
    this.scatter = new CaseScatter(chosen, figure("Cases: drag to zoom, double click for all, click to keep one"),
      (place) => this.show(place ?? this.pinned), (place) => this.pin(place));
    this.distribution = new CaseDistribution(chosen, figure("Distribution"));
    this.ranking = make("div", { class: "ranking" });
    stage.after(make("h3", {}, `What the metric depends on: ${this.packed.measure}`), this.ranking);
    this.buildTable(list);
  }

  makeSelectors() {
    const selector = (name, groups, set) => {
      const select = make("select", { name });
      for (const [label, columns] of groups) {
        const group = make("optgroup", { label });
        group.append(...columns.map((column) => make("option", { value: this.columns.indexOf(column) }, column.title)));
        select.append(group);
      }
      select.addEventListener("change", () => { set(this.columns[select.value]); this.chooseColumns(); });
      this[`${name}Select`] = select;
      return make("label", {}, name, select);
    };
    const [parameters, metrics] = [["parameters", this.parameters], ["metrics", this.metrics]];
    return [
      selector("metric", [metrics], (column) => { this.y = column; }),
      selector("over", [parameters, metrics], (column) => { this.x = column; }),
    ];
  }

  /** Place of the parameter that a metric depends on most. */
  strongest(metric) {
    const sizes = metric.ranking.map((value) => Math.abs(value ?? 0));
    return Math.max(0, sizes.indexOf(Math.max(...sizes)));
  }

  chooseColumns() {
    this.metricSelect.value = this.columns.indexOf(this.y);
    this.overSelect.value = this.columns.indexOf(this.x);
    this.scatter.make();
    this.distribution.make();
    this.rank();
    this.list();
    this.show(this.pinned);
  }

  /** Bars of the parameters; each is a button that puts its parameter on the horizontal axis. */
  rank() {
    const { ranking, influences, left } = this.y;
    const size = (k) => Math.abs(ranking[k] ?? 0);
    const order = [...ranking.keys()].sort((a, b) => size(b) - size(a)).slice(0, STRONGEST);
    const largest = Math.max(...order.map(size), this.packed.measure.startsWith("share") ? 1 : 0) || 1;
    this.ranking.replaceChildren(...order.map((k) => {
      const row = makeButton("", "Show over this parameter", () => { this.x = this.parameters[k]; this.chooseColumns(); });
      const bar = make("span", { class: "strength" });
      bar.style.width = `${(100 * size(k)) / largest}%`;
      bar.style.background = "var(--active)";
      row.append(make("span", {}, this.parameters[k].title), make("span", { class: "scale" }, bar),
        make("span", {}, influences[k] || "\u2013"));
      return row;
    }));
    if (left) this.ranking.append(make("p", { class: "caption" }, `What is left: ${left}.`));
    if (!order.length) this.ranking.replaceChildren(make("p", { class: "caption" }, "It does not vary, or has too few cases."));
  }

  command(place) { return this.packed.command.join(String(this.cases[place])); }

  /** Name a case: its numbers on both axes, and the command that runs it again. */
  show(place) {
    this.readout.replaceChildren();
    this.scatter.mark([place, this.pinned].filter((each) => each !== null));
    if (place === null) return;
    const text = (column) => `${column.title} ${describeValue(column, column.numbers[place])}`;
    this.readout.append(
      make("strong", {}, `case ${this.cases[place]}`), " ", make("span", {}, text(this.x)), " ",
      make("span", {}, text(this.y)), " ", make("code", {}, this.command(place)),
    );
  }

  /** Keep a case, or let it go. */
  pin(place) {
    this.pinned = this.pinned === place ? null : place;
    this.show(this.pinned);
    this.list();
  }

  buildTable(list) {
    this.which = make("select", { name: "which" });
    for (const [value, text] of [["all", "all cases"], ["above", "above the limit"], ["failed", "without a result"]]) {
      this.which.append(make("option", { value }, text));
    }
    this.search = make("input", { type: "search", name: "search", placeholder: "case, or name > value", size: 26 });
    this.which.addEventListener("change", () => this.list());
    this.search.addEventListener("input", () => this.list());
    this.counted = make("span", { class: "span" });
    const bar = make("div", { class: "bar" });
    bar.append(make("label", {}, "show", this.which), make("label", {}, "filter", this.search), this.counted);
    this.table = make("table", {});
    const frame = make("div", { class: "table" });
    frame.append(this.table);
    list.append(bar, frame);
  }

  /** Columns of the table: key, column, heading. */
  get listed() {
    const others = [this.x, ...this.parameters.filter((column) => column !== this.x)].filter((column) => column !== this.y);
    return [["case", null, "case"], ["metric", this.y, this.y.title], ...others.slice(0, 8).map((column) => [column.title, column, column.title])];
  }

  /** Whether a case is asked for: by its number, or as "mass > 51" in the unit that the table shows. */
  fits(place, words) {
    if (this.which.value === "above" && !(this.y.limit !== null && this.y.numbers[place] > this.y.limit)) return false;
    if (this.which.value === "failed" && !this.failed.has(this.cases[place])) return false;
    const condition = /^(.*?)\s*([<>])\s*(-?[\d.]+(?:e-?\d+)?)$/i.exec(words);
    if (!condition) return words === "" || String(this.cases[place]) === words;
    const wanted = condition[1].toLowerCase();
    const column = this.listed.map((each) => each[1]).find((each) => each && each.title.toLowerCase().includes(wanted));
    if (!column) return false;
    const value = column.numbers[place] * scaleColumn(column).factor;
    return condition[2] === "<" ? value < Number(condition[3]) : value > Number(condition[3]);
  }

  /** Places of the cases that the table shows, in its order; those without a number come last. */
  sorted() {
    const words = this.search.value.trim();
    const column = this.listed.find(([key]) => key === this.sort.key)?.[1];
    const key = (place) => (column ? column.numbers[place] : this.cases[place]);
    const sign = this.sort.down ? -1 : 1;
    return [...this.cases.keys()].filter((place) => this.fits(place, words)).sort((a, b) => {
      const [one, other] = [key(a), key(b)];
      if (Number.isFinite(one) !== Number.isFinite(other)) return Number.isFinite(one) ? -1 : 1;
      return sign * (one - other) || a - b;
    });
  }

  list() {
    const places = this.sorted();
    const head = make("tr");
    for (const [key, column, title] of this.listed) {
      const arrow = this.sort.key === key ? (this.sort.down ? " \u25bc" : " \u25b2") : "";
      const order = this.sort.key === key ? (this.sort.down ? "descending" : "ascending") : "none";
      const heading = make("th", { scope: "col", "aria-sort": order });
      heading.append(makeButton((column ? labelColumn(column) : title) + arrow, "Sort by this column", () => {
        this.sort = { key, down: this.sort.key === key ? !this.sort.down : true };
        this.list();
      }));
      head.append(heading);
    }
    head.append(make("th", { scope: "col", class: "words" }, "run it again"));
    const body = make("tbody");
    body.append(...places.slice(0, MOST_LISTED).map((place) => this.makeRow(place)));
    const header = make("thead");
    header.append(head);
    this.table.replaceChildren(header, body);
    const held = this.cases.length < this.packed.all ? `; the page holds ${this.cases.length} of ${this.packed.all} cases` : "";
    this.counted.textContent = `${Math.min(places.length, MOST_LISTED)} of ${places.length} shown${held}`;
  }

  makeRow(place) {
    const row = make("tr", { "data-case": this.cases[place] });
    if (place === this.pinned) row.classList.add("pinned");
    if (this.y.limit !== null && this.y.numbers[place] > this.y.limit) row.classList.add("missed");
    const why = this.failed.get(this.cases[place]);
    for (const [key, column] of this.listed) {
      const cell = make("td");
      if (!column) cell.append(makeButton(String(this.cases[place]), "Keep this case", () => this.pin(place)));
      else if (column.levels.length) cell.append(describeValue(column, column.numbers[place]));
      else cell.append(key === "metric" && why ? why : formatNumber(column.numbers[place] * scaleColumn(column).factor, 5));
      row.append(cell);
    }
    row.append(make("td", { class: "words" }, make("code", {}, this.command(place))));
    return row;
  }

  resize(printWidth) {
    this.scatter.resize(printWidth && (printWidth - 16) / 2);
    this.distribution.resize(printWidth && (printWidth - 16) / 2);
  }

  draw() {
    this.scatter.plot.redraw();
    this.distribution.plot.redraw();
  }
}
