/* Stacked charts with linked axes, on uPlot. `description.py` documents the description.

   const charts = HilCharts.draw(element, description, {keep: 120, follow: 30, bar: true});   // options may be omitted
     keep    drop data more than this many units of x before the end of a source
     follow  show the last this many units of x until the user zooms; a double click resumes following
     bar     whether to show the toolbar (default: true)
     first   show only this many charts until the user asks for the others
   charts.append({cycle: {x: [1.2], force: [40.1]}})   append rows; a missing column becomes a gap
   charts.replace({cycle: {x: [...], force: [...]}})   replace the rows of these sources, for example on seeking in a recording
   charts.mark({x: 3.1, text: "stop", kind: "stop"})   adds a mark
   charts.spans([{begin: 0, end: 2, text: "approach", kind: "approach"}])   replaces the previous ones
   charts.limits("force", [{value: 60, label: "force limit", kind: "limit"}])   replaces the previous ones
   charts.here(3.2)   draw a line at this x, such as the displayed moment; null removes it
   charts.zoom("time", 2, 5), charts.reset(), charts.layer("truth", false), charts.follow(30 or null), charts.destroy()

   Every text is set as text, never as HTML. */
"use strict";
var HilCharts = (() => {
  const BARS_MOST = 1500, ROOM_FROM = 0.5, MARK_REACH_PX = 7, NAMES_PX = 22, TEXT_LENGTH = 60, LEFT_PX = 58, PALETTE = /^[1-8]$/;
  let drawn = 0;

  const element = (tag, name, text) => {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const short = text => (text.length > TEXT_LENGTH ? text.slice(0, TEXT_LENGTH - 1) + "…" : text);
  const minus = value => String(value).replace(/^-/, "−");
  const number = value => {
    const size = Math.abs(value);
    if (size !== 0 && (size < 1e-3 || size >= 1e7)) return minus(value.toExponential(3));
    return minus(value.toFixed(size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3));
  };
  const lowest = (values, from, until) => {   // index of the first value that is not smaller
    let low = 0, high = values.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (values[middle] < from) low = middle + 1; else high = middle;
    }
    return low;
  };

  class Charts {
    constructor(place, spec, options) {
      this.place = place;
      this.spec = {marks: [], spans: [], layers: [], ...spec};
      this.spec.marks = [...this.spec.marks];
      this.sources = {};
      this.reaches = {};        // by source and column: smallest and largest value so far
      for (const [name, source] of Object.entries(spec.sources)) this.take(name, {...source});
      this.options = {bar: true, keep: null, follow: null, first: null, ...options};
      this.key = `hil-${++drawn}`;
      this.views = {};          // by axis: visible range, if it is not everything
      for (const [name, axis] of Object.entries(spec.axes)) if (axis.view) this.views[name] = axis.view;
      this.hidden = new Set();  // `chart/label` of the series switched off by the user
      this.layers = new Map(this.spec.layers.map(layer => [layer.id, layer.shown !== false]));
      this.charts = [];
      this.order = [];          // charts of a growing run, as they appeared: a later one comes last, and none vanishes
      this.frame = 0;
      this.dark = matchMedia("(prefers-color-scheme: dark)");
      this.rebuild = () => this.build();
      this.fit = () => this.resize();
      this.toPrint = () => { document.documentElement.dataset.theme = "light"; this.printing = true; this.build(); };
      this.fromPrint = () => { delete document.documentElement.dataset.theme; this.printing = false; this.build(); };
      this.dark.addEventListener("change", this.rebuild);
      addEventListener("beforeprint", this.toPrint);
      addEventListener("afterprint", this.fromPrint);
      place.replaceChildren();
      place.classList.add("hil-charts");
      place.classList.toggle("hil-named", this.isNamed());   // few points each: several charts in a row
      place.tabIndex = 0;
      place.setAttribute("role", "group");
      place.setAttribute("aria-label", "charts; arrow keys move, plus and minus zoom, 0 shows all");
      place.addEventListener("keydown", event => this.pressed(event));
      this.bar = this.makeBar();
      this.stack = element("div", "hil-stack");
      place.append(this.bar, this.stack, this.more);
      this.build();
      this.observer = new ResizeObserver(this.fit);
      this.observer.observe(this.stack);
    }

    // methods for pages

    take(name, source) {
      this.sources[name] = source;
      delete this.reaches[name];
      this.measure(name, source);
    }

    measure(name, rows) {   // null and missing values are gaps
      const reaches = this.reaches[name] || (this.reaches[name] = {});
      for (const [column, values] of Object.entries(rows)) {
        let [low, high] = reaches[column] || [Infinity, -Infinity];
        for (const value of values) if (value !== null && value !== undefined) { if (value < low) low = value; if (value > high) high = value; }
        if (low <= high) reaches[column] = [low, high];
      }
    }

    span(source, column) {   // of all values so far; -1 without any
      const reach = (this.reaches[source] || {})[column];
      return reach ? reach[1] - reach[0] : -1;
    }

    shows(spec, index) {   // charts without values, or with almost constant ones, are omitted
      if (index === 0 || (spec.bands || []).some(band => this.span(band.source, band.low) >= 0)) return true;
      const least = spec.quiet_span === undefined || spec.quiet_span === null ? -1 : spec.quiet_span;
      return (spec.series || []).some(one => this.span(one.source, one.column) > least);
    }

    append(rows) {
      for (const [name, added] of Object.entries(rows)) {
        const source = this.sources[name] || (this.sources[name] = {x: []});
        const before = source.x.length;
        for (const column of new Set([...Object.keys(source), ...Object.keys(added)])) {
          const values = source[column] || (source[column] = new Array(before).fill(null));
          const more = added[column] || new Array(added.x.length).fill(null);
          for (const value of more) values.push(value);
        }
        this.measure(name, added);
        if (this.options.keep === null) continue;
        const gone = lowest(source.x, source.x[source.x.length - 1] - this.options.keep);
        if (gone > source.x.length / 4) for (const values of Object.values(source)) values.splice(0, gone);
      }
      this.soon();
    }

    replace(sources) {
      for (const [name, source] of Object.entries(sources)) this.take(name, {...source});
      this.soon();
    }

    mark(mark) { this.spec.marks.push(mark); this.soon(); }

    spans(spans) {
      const renamed = spans.map(one => one.text).join() !== this.spec.spans.map(one => one.text).join();
      this.spec.spans = spans;
      if (renamed) this.fillPlaces();   // an open list stays open
      this.soon();
    }

    here(x) { this.moment = x; this.soon(); }

    limits(chart, limits) {
      const spec = this.spec.charts.find(one => one.id === chart), found = this.charts.find(one => one.spec.id === chart);
      if (spec) spec.limits = limits;
      if (found) { this.dress(found); this.soon(); }
    }

    zoom(axis, from, to) {
      const whole = this.extent(axis), least = (whole[1] - whole[0]) * 1e-5;
      if (!(to - from > least)) return;
      this.views[axis] = [from, to];
      this.show();
    }

    reset() { this.views = {}; if (this.places) this.places.value = ""; this.show(); }

    follow(seconds) {
      this.options.follow = seconds; this.views = {};
      if (this.places) this.fillPlaces();
      this.show();
    }

    layer(id, shown) {
      this.layers.set(id, shown);
      const box = [...this.bar.querySelectorAll("input")].find(one => one.dataset.layer === id);
      if (box) box.checked = shown;
      this.applyLayers();
    }

    destroy() {
      cancelAnimationFrame(this.frame);
      this.observer.disconnect();
      this.dark.removeEventListener("change", this.rebuild);
      removeEventListener("beforeprint", this.toPrint);
      removeEventListener("afterprint", this.fromPrint);
      for (const chart of this.charts) chart.plot.destroy();
      this.place.replaceChildren();
    }

    // toolbar

    isNamed() { return Object.values(this.spec.axes).every(axis => axis.names && axis.names.length); }

    makeBar() {
      const bar = element("div", "hil-bar");
      bar.hidden = !this.options.bar;
      const button = (text, name, act, look = "") => {
        const made = element("button", look, text);
        made.type = "button";
        made.title = name;
        made.setAttribute("aria-label", name);
        made.addEventListener("click", act);
        bar.append(made);
      };
      if (!this.isNamed()) {
        button("−", "zoom out", () => this.scale(2));
        button("+", "zoom in", () => this.scale(0.5));
        button("◀", "earlier", () => this.move(-0.3), "hil-move");
        button("▶", "later", () => this.move(0.3), "hil-move");
        button("all", "show all", () => this.reset());
      }
      this.places = element("select");
      this.places.setAttribute("aria-label", "zoom to");
      this.places.addEventListener("change", () => {
        const span = this.spec.spans[Number(this.places.value)];
        if (this.places.value === "" || !span) { this.reset(); return; }
        const room = (span.end - span.begin) * 0.02;
        this.zoom(span.axis || "time", span.begin - room, span.end + room);
      });
      bar.append(this.places);
      this.fillPlaces();
      for (const layer of this.spec.layers) {
        const label = element("label"), box = element("input");
        box.type = "checkbox";
        box.checked = this.layers.get(layer.id);
        box.dataset.layer = layer.id;
        box.addEventListener("change", () => this.layer(layer.id, box.checked));
        label.append(box, layer.label);
        bar.append(label);
      }
      this.more = element("button", "hil-more");
      this.more.type = "button";
      this.more.addEventListener("click", () => { this.options.first = null; this.build(); });
      this.note = element("div", "hil-note", this.hint());
      this.note.title = this.isNamed() ? "" : "shift and drag moves, ctrl and wheel zooms";
      bar.append(this.note);
      return bar;
    }

    hint() {
      return this.isNamed() ? "" : matchMedia("(pointer: coarse)").matches ? "one finger: move · two fingers: zoom"
        : "drag zooms · double click resets";
    }

    fillPlaces() {
      const first = element("option", "", this.options.follow === null ? "full run" : `last ${this.options.follow} s`);
      first.value = "";
      this.places.replaceChildren(first);
      this.spec.spans.forEach((span, index) => {
        if (span.end === null || span.end === undefined) return;
        const option = element("option", "", short(span.text));
        option.value = String(index);
        this.places.append(option);
      });
      this.places.hidden = this.places.options.length < 2;
    }

    pressed(event) {
      if (event.target !== this.place) return;
      const act = {ArrowLeft: () => this.move(-0.2), ArrowRight: () => this.move(0.2), "+": () => this.scale(0.5),
        "=": () => this.scale(0.5), "-": () => this.scale(2), 0: () => this.reset()}[event.key];
      if (act) { event.preventDefault(); act(); }
    }

    scale(factor) {
      for (const axis of Object.keys(this.spec.axes)) {
        const [from, to] = this.view(axis), middle = (from + to) / 2, half = (to - from) / 2 * factor;
        this.place_(axis, middle - half, middle + half);
      }
    }

    move(part) {
      for (const axis of Object.keys(this.spec.axes)) {
        const [from, to] = this.view(axis);
        this.place_(axis, from + (to - from) * part, to + (to - from) * part);
      }
    }

    place_(axis, from, to) {   // stays within the data
      const [low, high] = this.extent(axis);
      if (to - from >= high - low) { delete this.views[axis]; this.show(); return; }
      const shift = from < low ? low - from : to > high ? high - to : 0;
      this.zoom(axis, from + shift, to + shift);
    }

    // visible range

    extent(axis) {
      let low = Infinity, high = -Infinity;
      const reach = (from, to) => { low = Math.min(low, from); high = Math.max(high, to); };
      for (const chart of this.spec.charts) {
        if ((chart.axis || "time") !== axis) continue;
        for (const one of [...(chart.series || []), ...(chart.bands || [])]) {
          const x = (this.sources[one.source] || {x: []}).x;
          if (x.length) reach(x[0], x[x.length - 1]);
        }
      }
      for (const span of this.spec.spans) {
        if ((span.axis || "time") === axis) reach(span.begin, span.end ?? span.begin);
      }
      if (this.spec.axes[axis].names) return [low - 0.5, high + 0.5];   // half a step before the first name and after the last
      return low < high ? [low, high] : low === high ? [low - 0.5, high + 0.5] : [0, 1];
    }

    view(axis) {
      if (this.views[axis]) return this.views[axis];
      const [low, high] = this.extent(axis);
      return this.options.follow === null ? [low, high] : [Math.max(high - this.options.follow, low), high];
    }

    soon() {
      if (!this.frame) this.frame = requestAnimationFrame(() => { this.frame = 0; this.show(true); });
    }

    shown() {
      const all = this.spec.charts.filter((spec, index) => this.order.includes(spec) || this.shows(spec, index));
      if (this.options.keep !== null) {   // also after its end, so that a resize does not move them
        this.order.push(...all.filter(spec => !this.order.includes(spec)));
        all.sort((one, other) => this.order.indexOf(one) - this.order.indexOf(other));
      }
      const visible = this.options.first === null || this.printing ? all : all.slice(0, this.options.first);
      this.more.hidden = visible.length === all.length;
      this.more.textContent = `${all.length - visible.length} more charts`;
      return visible;
    }

    show(renewed) {
      if (renewed && this.shown().length !== this.charts.length) { this.build(); return; }
      for (const chart of this.charts) {
        const [min, max] = chart.ordered = this.view(chart.axis);
        chart.plot.batch(() => {
          if (renewed) {
            chart.plot.setData(this.data(chart), false);
            const known = chart.lines.filter(line => this.span(line.source, line.column) >= 0).length;
            if (chart.known !== known) { chart.known = known; this.dress(chart); }
          }
          chart.plot.setScale("x", {min, max});
        });
      }
    }

    applyLayers() {
      for (const chart of this.charts) {
        chart.lines.forEach((line, index) => {
          const on = this.isOn(chart, line);
          if (chart.plot.series[index + 1].show !== on) chart.plot.setSeries(index + 1, {show: on}, false);
        });
        this.dress(chart);
        chart.plot.redraw(true);
      }
    }

    isOn(chart, line) {
      return (!line.layer || this.layers.get(line.layer) !== false) && !this.hidden.has(`${chart.spec.id}/${line.label}`);
    }

    // building

    colour(name) {
      const wanted = PALETTE.test(name) ? `--c${name}` : `--c-${name}`;
      return this.css.getPropertyValue(wanted).trim() || this.css.getPropertyValue("--c1").trim();
    }

    width(box = this.stack) {
      const room = Math.max(Math.floor(box.clientWidth), 260);
      return this.printing ? Math.min(room, 690) : room;
    }

    build() {
      this.css = getComputedStyle(document.documentElement);
      for (const chart of this.charts) chart.plot.destroy();
      this.stack.replaceChildren();
      const shown = this.shown();
      this.isGrid = getComputedStyle(this.stack).display === "grid";   // charts side by side align: none has the axis' label
      this.charts = shown.map((spec, index) => this.makeChart(spec, index, shown));
      this.show();
    }

    resize() {
      if (!this.place.classList.contains("hil-over")) this.note.textContent = this.hint();
      for (const chart of this.charts) {
        const width = this.width(chart.box);
        if (chart.plot.width !== width) chart.plot.setSize({width, height: chart.spec.height_px || 180});
      }
    }

    makeChart(spec, index, shown) {
      const axis = spec.axis || "time";
      const last = !this.isGrid && !shown.slice(index + 1).some(other => (other.axis || "time") === axis);
      const lines = [], bands = [];
      for (const band of spec.bands || []) {   // uPlot fills between two adjacent series; every line is drawn on the bands
        bands.push({series: [lines.length + 2, lines.length + 1], fill: this.colour(band.colour || "faint") + (band.colour ? "38" : "88")});
        const edge = {source: band.source, colour: band.colour || "faint", layer: band.layer, width: 0.4, label: band.label};
        lines.push({...edge, column: band.low, edge: "least"}, {...edge, column: band.high, edge: "greatest"});
      }
      lines.push(...(spec.series || []));
      const box = element("div", "hil-chart"), chart = {spec, axis, lines, first: index === 0, last, box};
      box.dataset.chart = spec.id;
      const title = element("div", "hil-title", spec.title + " ");
      chart.subtitle = element("span", "");
      title.append(chart.subtitle);
      box.append(title);
      this.stack.append(box);
      const options = {
        width: this.width(box), height: spec.height_px || 180, padding: [6, 16, 0, 0],
        legend: {markers: {dash: (u, k) => (k === 0 ? "solid" : lines[k - 1].dashed ? (lines[k - 1].colour === "target" ? "dotted" : "dashed") : lines[k - 1].style === "points" ? "dotted" : "solid")}},
        cursor: this.cursor(chart), bands, hooks: this.hooks(chart), focus: {alpha: 1},
        scales: {x: {time: false, auto: false, distr: this.spec.axes[axis].log ? 3 : 1}, y: {distr: spec.log ? 3 : 1, range: (u, low, high) => this.range(chart, low, high)}},
        axes: [this.xAxis(chart), this.yAxis()],
        series: [{label: this.spec.axes[axis].label, value: (u, x) => this.at(axis, x)},
          ...lines.map(line => this.series(chart, line))],
      };
      chart.plot = new uPlot(options, this.data(chart), box);
      HilPointer.attach(this, chart);
      chart.rows = [...chart.plot.root.querySelectorAll(".u-series")];
      chart.rows.forEach((row, k) => {
        if (k === 0 || lines[k - 1].edge === "least") row.classList.add("hil-none");   // the toolbar shows x; a band is one entry
        if (k && lines[k - 1].style === "points") row.classList.add("hil-dots");
        if (k && lines[k - 1].edge) row.parentNode.append(row);   // after the lines
      });
      this.dress(chart);
      return chart;
    }

    dress(chart) {   // series of a hidden layer are not in the legend; the title lists every limit
      const limits = (chart.spec.limits || []).map(one => `${one.label} ${minus(Number(one.value.toPrecision(5)))}`);
      chart.subtitle.textContent = [chart.spec.unit, ...limits].filter(Boolean).join(" · ");
      chart.rows.forEach((row, k) => {
        const line = chart.lines[k - 1];
        row.classList.toggle("hil-hidden", Boolean(line && (this.span(line.source, line.column) < 0
          || (line.layer && this.layers.get(line.layer) === false))));
      });
    }

    series(chart, line) {
      const stroke = this.colour(line.colour || "1"), style = line.style || "line";
      const unit = chart.spec.unit ? " " + chart.spec.unit : "";
      const named = Boolean(this.spec.axes[chart.axis].names);   // few values, each of a name
      const points = {show: style === "points" || named ? true : undefined, size: named ? 8 : 4, stroke, fill: stroke};
      const made = {
        label: line.label, stroke, width: line.width || 1.5, spanGaps: false,
        show: this.isOn(chart, line), points,
        value: (u, value, k, row) => value === null || value === undefined ? "–"
          : line.edge && row !== null && Number.isFinite(u.data[k - 1][row]) ? `${number(u.data[k - 1][row])} … ${number(value)}${unit}`
          : line.values && line.values.length ? line.values[value] ?? number(value) : number(value) + unit,
      };
      if (line.dashed) made.dash = line.colour === "target" ? [2, 3] : [6, 4];
      if (line.edge) made.points = {show: false};
      if (style === "step") { made.paths = uPlot.paths.stepped({align: 1}); made.points = {show: false}; }
      if (style === "points") made.paths = () => null;
      if (style === "bars") {   // many bars would merge
        const bars = uPlot.paths.bars({size: [0.6, 4]}), line = uPlot.paths.linear();
        made.paths = (u, k, from, to) => (to - from > BARS_MOST ? line : bars)(u, k, from, to);
        made.fill = (u, k) => (u.series[0].idxs && u.series[0].idxs[1] - u.series[0].idxs[0] > BARS_MOST ? "transparent" : stroke);
        made.points = {show: false};
      }
      return made;
    }

    data(chart) {
      const tables = new Map();   // one per source, joined if there are several
      chart.lines.forEach((line, index) => {
        if (!tables.has(line.source)) tables.set(line.source, []);
        tables.get(line.source).push(index);
      });
      const column = line => {
        const source = this.sources[line.source] || {x: []};
        const values = source[line.column] || new Array(source.x.length).fill(null);
        return chart.spec.log ? values.map(value => (value > 0 ? value : null)) : values;
      };
      const x = name => (this.sources[name] || {x: []}).x;
      if (tables.size === 0) return [[]];
      if (tables.size === 1) return [x([...tables.keys()][0]), ...chart.lines.map(column)];
      const joined = uPlot.join([...tables].map(([name, indices]) => [x(name), ...indices.map(i => column(chart.lines[i]))]));
      const data = [joined[0]];
      [...tables.values()].flat().forEach((index, k) => { data[index + 1] = joined[k + 1]; });
      return data;
    }

    range(chart, low, high) {
      const spec = chart.spec;
      if (low === null || high === null || low === undefined) return spec.log ? [1, 10] : [0, Math.max(spec.least_span || 0, 1)];
      if (spec.log) return [10 ** Math.floor(Math.log10(low)), 10 ** Math.ceil(Math.log10(high * 1.0001))];
      for (const limit of spec.limits || []) {   // the same rule as `painter.y_range`
        const near = (limit.kind || "limit") === "limit" && (limit.value > 0 ? high >= ROOM_FROM * limit.value : low <= ROOM_FROM * limit.value);
        if (limit.shown || near) { low = Math.min(low, limit.value); high = Math.max(high, limit.value); }
      }
      if (spec.zero) { low = Math.min(low, 0); high = Math.max(high, 0); }
      const missing = Math.max((spec.least_span || 0) - (high - low), high === low ? Math.abs(high) * 0.1 || 1 : 0) / 2;
      if (missing > 0) { low -= missing; high += missing; }
      const room = (high - low) * 0.08, named = chart.first && this.spec.spans.length ? NAMES_PX / (spec.height_px || 180) * (high - low) : 0;
      return [spec.zero && low === 0 ? 0 : low - room, spec.zero && high === 0 ? named : high + Math.max(room, named)];
    }

    xAxis(chart) {
      const axis = this.spec.axes[chart.axis];
      return {
        stroke: this.css.getPropertyValue("--quiet").trim(), font: "11px system-ui, sans-serif", size: 22,
        labelFont: "11px system-ui, sans-serif", labelSize: 18, gap: 3,
        label: chart.last && !axis.names ? [axis.label, axis.unit].filter(Boolean).join(", ") : undefined,
        ...(axis.names ? {incrs: [1, 2, 5, 10, 20, 50]} : {}),
        values: (u, splits) => splits.map((value, k) => axis.names ? axis.names[value] ?? "" : value === null ? ""   // the unit is repeated above the last chart's label
          : minus(Number(value.toPrecision(6))) + (k === splits.length - 1 && !chart.last ? ` ${axis.unit}` : "")),
        ...this.lines(),
      };
    }

    yAxis() {
      return {stroke: this.css.getPropertyValue("--quiet").trim(), font: "11px system-ui, sans-serif", size: LEFT_PX, gap: 4,
        values: (u, splits) => splits.map(value => value === null ? "" : Math.abs(value) >= 1e5 || (value !== 0 && Math.abs(value) < 1e-3)
          ? minus(value.toExponential(0)) : minus(Number(value.toPrecision(6)))), ...this.lines()};
    }

    lines() {
      const stroke = this.css.getPropertyValue("--grid").trim();
      return {grid: {stroke, width: 1}, ticks: {stroke, width: 1, size: 4}};
    }

    at(axis, x) {
      if (x === null || x === undefined) return "–";
      const {unit, names, wall_start_s: start} = this.spec.axes[axis];
      if (names) return names[x] ?? "";
      const wall = start === undefined || start === null ? "" : ` · ${new Date((start + x) * 1e3).toISOString().slice(11, 23)} UTC`;
      return `${x.toFixed(3)} ${unit}${wall}`;
    }

    // pointer, wheel, touch

    cursor(chart) {
      return {
        y: false, drag: {x: true, y: false, dist: 6, setScale: true}, focus: {prox: -1},
        sync: {key: `${this.key}-${chart.axis}`, setSeries: false, scales: ["x", null],
          filters: {pub: kind => kind === "mousemove" || kind === "mouseleave", sub: kind => kind === "mousemove" || kind === "mouseleave"}},
        bind: {dblclick: () => event => { event.preventDefault(); this.reset(); }},
        dataIdx: (u, series, index) => {   // the nearest value, if several sources were joined
          const values = u.data[series];
          if (!values || values[index] !== undefined) return index;
          for (let step = 1; step < 400; step++) {
            if (values[index - step] !== undefined) return index - step;
            if (values[index + step] !== undefined) return index + step;
          }
          return index;
        },
      };
    }

    hooks(chart) {
      return {
        setScale: [(u, key) => {
          if (key !== "x" || !chart.ordered) return;
          const {min, max} = u.scales.x, [low, high] = chart.ordered;   // uPlot reports it later, also for changes made by `show`
          if (min !== low || max !== high) this.zoom(chart.axis, min, max);
        }],
        setSeries: [(u, index, set) => {
          if (index === null || !("show" in set) || !chart.plot) return;
          const line = chart.lines[index - 1];
          if (line.layer && this.layers.get(line.layer) === false) return;
          const other = line.edge === "least" ? index + 1 : line.edge ? index - 1 : index;   // both edges of a band
          if (u.series[other].show !== set.show) u.setSeries(other, {show: set.show});
          this.hidden[set.show ? "delete" : "add"](`${chart.spec.id}/${line.label}`);
        }],
        setCursor: [u => this.tell(chart, u)],
        drawClear: [u => HilMarks.behind(this, chart, u)],
        draw: [u => HilMarks.before(this, chart, u)],
      };
    }

    tell(chart, u) {
      const here = u.cursor.left !== undefined && u.cursor.left >= 0;
      const over = here || this.charts.some(other => other.plot.cursor.left >= 0);
      this.place.classList.toggle("hil-over", over);
      if (!over) this.note.textContent = this.hint();
      if (!here) return;
      const near = this.spec.marks.filter(mark => (mark.axis || "time") === chart.axis
        && (!mark.layer || this.layers.get(mark.layer) !== false)
        && Math.abs(u.valToPos(mark.x, "x") - u.cursor.left) < MARK_REACH_PX);
      const notes = near.map(mark => `${mark.x.toFixed(3)} ${this.spec.axes[chart.axis].unit}: ${mark.text}`).join("   |   ");
      const text = this.at(chart.axis, u.posToVal(u.cursor.left, "x")) + (notes && `   |   ${notes}`);
      if (this.note.textContent !== text) this.note.textContent = text;
    }
  }

  return {draw: (place, description, options) => new Charts(place, description, options)};
})();
