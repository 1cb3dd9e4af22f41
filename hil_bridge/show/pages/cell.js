/* The cell in three dimensions: arm, tool, work piece, path and force. `charts/cell.py` describes the model.

   const cell = HilCell.draw(element, model, {bar: true, moved: t => …, plain: false});   options may be omitted
     bar     whether to show ▶ and the slider (default: true)
     moved   called with the displayed time
     keep    drop the oldest rows above this number
     plain   draw without WebGL
   cell.rows(rows, start)   append columns of cycles, of the truth, and of the path if its points are denser; positions are mm from the start point, which is in m
   cell.show(t)             display a moment, s; null follows the newest rows
   cell.view("tool"), cell.view("cell"), cell.paint("deviation"), cell.play(), cell.pause(), cell.destroy() */
"use strict";
var HilCell = (() => {
  const {plus, minus, size, unit, posed, along, camera, projected, point} = HilSpace;
  const REBUILD_MS = 300, STILL_MS = 200, LIVE_MS = 100, MARK_MS = 100, COARSE = 0.75, CUT_M = 0.03, WIDEST = 1.0, SPLIT_PX = 600, GHOST_M = 0.003, FLAT = 0.01, SPEEDS = [1, 4, 16];
  const PAINTS = {force: ["Force", "N", "amount"], deviation: ["Force error", "N", "sign"], removed: ["Removed depth at the end", "µm", "amount"]};
  const element = (tag, name, text) => {
    const made = document.createElement(tag);
    if (name) made.className = name;
    if (text !== undefined) made.textContent = text;
    return made;
  };
  const digits = value => (Number.isFinite(value) ? String(Number(value.toPrecision(3))).replace("-", "−") : "–");
  const rgb = text => [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16) / 255);
  const css = (style, name) => { const text = style.getPropertyValue(name).trim(); return /^#[0-9a-f]{6}$/i.test(text) ? rgb(text) : [0.5, 0.5, 0.5]; };
  const ramp = (stops, share) => {
    const at = Math.min(Math.max(share, 0), 1) * (stops.length - 1), k = Math.min(Math.floor(at), stops.length - 2);
    return stops[k].map((one, c) => (one + (stops[k + 1][c] - one) * (at - k)) / 255);
  };
  const until = (x, t) => { let low = 0, high = x.length; while (low < high) { const m = (low + high) >> 1; if (x[m] <= t) low = m + 1; else high = m; } return low; };
  const known = list => list && list.every(Number.isFinite);
  const NAMES = {p: ["position_x", "position_y", "position_z"], q: ["turn_w", "turn_x", "turn_y", "turn_z"], push: ["force_x", "force_y", "force_z"],
    joints: [1, 2, 3, 4, 5, 6].map(k => `joint_${k}`)};

  class Cell {
    constructor(place, model, options) {
      this.place = place; this.model = model; this.options = {bar: true, keep: Infinity, moved: () => {}, ...options};
      this.tables = {cycle: {x: []}, truth: {x: []}, path: {x: []}};
      this.at = null; this.playing = false; this.speed = 0; this.frames = 0; this.markedAt = 0; this.drawn = 0;
      this.now = "force"; this.near = "tool"; this.cameras = {};
      this.dark = matchMedia("(prefers-color-scheme: dark)");
      this.recolour = () => this.soon();
      this.dark.addEventListener("change", this.recolour);
      this.build();
      this.space = HilSpace.open(this.canvas, this.options.plain);
      this.shapes = {arrow: HilParts.arrow(), floor: HilParts.floor(1.5, 0.25)};
      this.shape();
      this.observer = new ResizeObserver(() => this.soon());
      this.observer.observe(this.stage);
    }

    // ---- methods for pages

    rows(rows, start) {
      for (const [name, table] of Object.entries(this.tables)) {
        const added = rows[name];
        if (!added) continue;
        const column = (key, k) => { const list = added[key]; return Array.isArray(list) ? list[k] : list; };   // a constant is a single value
        const many = (key, k) => { const all = NAMES[key].map(one => column(one, k)); return known(all) ? all : null; };
        const put = (key, value) => (table[key] || (table[key] = [])).push(value);
        added.x.forEach((x, k) => {
          const p = many("p", k);
          if (!p) return;
          put("x", x); put("p", p.map((one, m) => start[m] + one * 1e-3));
          put("q", many("q", k)); put("push", many("push", k)); put("joints", many("joints", k));
          put("force", column("force", k) ?? null); put("target", column("force_reference", k) ?? null); put("touch", column("in_contact", k) === 1);
        });
        const gone = table.x.length - this.options.keep;
        if (gone > 0) for (const list of Object.values(table)) list.splice(0, gone);
      }
      const {x} = this.tables.cycle;
      if (x.length) this.bounds(x[0], x[x.length - 1]);
      this.stale = true;
      this.soon();
    }

    bounds(from, to) {   // of the slider; after the last row, the cell keeps its pose
      this.until = to;
      if (this.slider) { this.slider.min = from; this.slider.max = to; }
    }

    show(t) { this.at = t; this.soon(); }

    view(name) { this.near = name; this.soon(); }

    paint(name) { this.now = this.chosen = name; if (this.select) this.select.value = name; this.path = null; this.wear = null; this.soon(); }

    play() {
      const {x} = this.tables.cycle;
      if (!x.length) return;
      if (this.at === null || this.at >= this.until) this.at = x[0];
      this.playing = true;
      this.since = performance.now();
      this.button.textContent = "❚❚"; this.button.setAttribute("aria-label", "pause");
      this.soon();
    }

    pause() { this.playing = false; this.button.textContent = "▶"; this.button.setAttribute("aria-label", "play"); }

    destroy() {
      cancelAnimationFrame(this.frame);
      clearTimeout(this.still);
      clearTimeout(this.later);
      this.observer.disconnect();
      this.dark.removeEventListener("change", this.recolour);
      this.place.replaceChildren();
    }

    // ---- elements

    build() {
      this.place.replaceChildren();
      this.place.classList.add("hil-cell");
      this.stage = element("div", "hil-stage");
      this.canvas = element("canvas");
      this.canvas.tabIndex = 0;
      this.canvas.setAttribute("role", "img");
      this.canvas.setAttribute("aria-label", "the cell in three dimensions; arrow keys turn, shift and arrow keys move, plus and minus zoom, 0 resets");
      this.tag = element("span", "hil-force");
      this.key = element("div", "hil-key");
      this.scale = element("div", "hil-scale");
      this.inset = element("button", "hil-inset");
      this.inset.type = "button";
      this.inset.addEventListener("click", () => this.view(this.near === "tool" ? "cell" : "tool"));
      this.stage.append(this.canvas, this.tag, this.inset);
      this.select = element("select");
      this.select.setAttribute("aria-label", "colour of the path");
      this.select.addEventListener("change", () => this.paint(this.select.value));
      const legend = element("div", "hil-legend");
      legend.append(this.key, this.select, this.scale);
      this.place.append(this.stage, legend);
      if (this.options.bar) this.buildPlayer();
      HilOrbit.attach(this);
    }

    buildPlayer() {
      this.button = element("button", "hil-play", "▶");
      this.button.type = "button"; this.button.setAttribute("aria-label", "play");
      this.button.addEventListener("click", () => (this.playing ? this.pause() : this.play()));
      this.slider = element("input");
      Object.assign(this.slider, {type: "range", min: 0, max: 1, step: "any"});
      this.slider.setAttribute("aria-label", "time");
      this.slider.addEventListener("input", () => { this.pause(); this.show(Number(this.slider.value)); });
      this.clock = element("output");
      const fast = element("button", "", "1×");
      fast.type = "button"; fast.title = "speed"; fast.setAttribute("aria-label", "speed");
      fast.addEventListener("click", () => { this.speed = (this.speed + 1) % SPEEDS.length; fast.textContent = `${SPEEDS[this.speed]}×`; });
      const bar = element("div", "hil-cell-bar");
      bar.append(this.button, this.slider);   // the slider is as wide as the plots below it
      this.place.append(bar);
      this.place.querySelector(".hil-legend").append(this.clock, fast);
    }

    shape() {   // the meshes that do not change
      const {arm, piece, tool} = this.model;
      this.shapes.tool = HilParts.tool(tool.length, tool.radius);
      if (arm) { arm.tool = tool.length; this.shapes.links = HilParts.links(arm); }
      this.grid = piece ? HilParts.grid(piece) : null;
      this.shapes.piece = piece ? HilParts.piece(piece) : null;
      this.choices();
    }

    choices() {
      const had = Object.keys(PAINTS).filter(name => name === "force" || (name === "removed" ? this.model.removed : this.tables.cycle.target?.some(Number.isFinite)));
      if (had.join() === this.had) return;
      this.had = had.join();
      this.select.replaceChildren(...had.map(name => { const one = element("option", "", PAINTS[name].slice(0, 2).join(", ")); one.value = name; return one; }));
      this.select.hidden = had.length < 2;
    }

    // ---- the moment

    newest() {   // the last time for which all tables have a row
      return Math.min(...["cycle", "truth"].map(name => this.tables[name].x).filter(x => x.length).map(x => x[x.length - 1]));
    }

    row(name, t) {   // interpolated values of a table
      const table = this.tables[name], count = table.x.length;
      if (!count) return null;
      const after = until(table.x, t), a = Math.max(after - 1, 0), b = Math.min(after, count - 1);
      const span = table.x[b] - table.x[a], share = span > 0 ? Math.min(Math.max((t - table.x[a]) / span, 0), 1) : 0;
      const mix = key => {
        const [p, q] = [table[key][a], table[key][b]];
        if (!p || !q || !share) return p;
        const sign = key === "q" && p.reduce((sum, one, k) => sum + one * q[k], 0) < 0 ? -1 : 1, mixed = p.map((one, k) => one + (sign * q[k] - one) * share);
        const length = key === "q" ? Math.hypot(...mixed) : 1;
        return mixed.map(one => one / length);
      };
      return {p: mix("p"), q: mix("q"), push: mix("push"), joints: mix("joints"), touch: table.touch[a], force: table.force[a]};
    }

    soon() {
      if (this.frame || this.later) return;
      const next = () => { this.later = 0; this.frame = requestAnimationFrame(now => { this.frame = 0; this.draw(now); }); };
      const rest = this.space && this.space.software && !this.options.bar ? LIVE_MS - (performance.now() - (this.last ?? 0)) : 0;
      if (rest > 0) this.later = setTimeout(next, rest); else next();   // a live run on the same processor goes first
    }

    step(now) {
      this.at = Math.min(this.at + (now - this.since) / 1000 * SPEEDS[this.speed], this.until);
      this.since = now;
      if (this.at >= this.until) this.pause(); else this.soon();
    }

    draw(now) {
      if (this.playing) this.step(Math.max(now, this.since));
      this.place.hidden = !this.tables.cycle.x.length;
      this.fit(this.space.software && this.isMoving(now));
      if (this.place.hidden || !this.canvas.width) return;
      if (!this.path || (this.stale && (now - this.drawn > REBUILD_MS || this.at !== null))) this.trace(now);
      else if (this.stale) this.soon();
      const t = this.at ?? this.newest(), reported = this.row("cycle", t), truth = this.row("truth", t), style = getComputedStyle(document.documentElement);
      const colours = {back: css(style, "--raised"), line: css(style, "--line"), stand: css(style, "--line").map((one, k) => 0.75 * one + 0.25 * css(style, "--quiet")[k]), ghost: css(style, "--c2"), arrow: css(style, "--c1")};
      this.isOld = t > this.tables.cycle.x[this.tables.cycle.x.length - 1];   // the robot reports nothing any more
      const items = this.items(reported, truth, colours);
      this.views = this.split();
      for (const view of this.views) {
        view.eye = camera(this.camera(view.name, view.box), view.box.width / view.box.height);
        this.space.draw(items, view.eye, view.box, colours.back);
      }
      this.label(reported, truth);
      if (this.slider) {
        this.slider.value = t;
        this.clock.textContent = `${t.toFixed(1)} s`;
      }
      if (this.at !== this.marked && (!this.playing || now - this.markedAt > MARK_MS)) { this.marked = this.at; this.markedAt = now; this.options.moved(this.at); }
      this.frames++;
    }

    isMoving(now) {   // then a picture in a lower resolution follows faster; the still picture comes afterwards
      const moves = this.playing || this.orbited || now - (this.last ?? -Infinity) < STILL_MS;
      this.orbited = false;
      this.last = now;
      clearTimeout(this.still);
      if (moves) this.still = setTimeout(() => { this.last = -Infinity; this.soon(); }, 2 * STILL_MS);
      return moves;
    }

    fit(coarse) {
      const ratio = coarse ? (this.playing ? COARSE : 1) : this.space.software ? 2 : Math.min(devicePixelRatio || 1, 2), width = Math.round(this.stage.clientWidth * ratio), height = Math.round(this.stage.clientHeight * ratio);
      if (this.canvas.width !== width || this.canvas.height !== height) { this.canvas.width = width; this.canvas.height = height; }
      this.ratio = ratio;
    }

    split() {   // the views and their places: side by side, or one in a corner of the other
      const {width, height} = this.canvas, wide = this.wide = this.stage.clientWidth >= SPLIT_PX, left = wide ? Math.round(width * 0.4) : 0;
      this.stage.classList.toggle("hil-split", wide);
      this.inset.hidden = wide || this.space.kind !== "webgl";
      if (wide) return [{name: "cell", box: {left: 0, top: 0, width: left, height}}, {name: "tool", box: {left, top: 0, width: width - left, height}}];
      const all = [{name: this.near, box: {left: 0, top: 0, width, height}}];
      if (this.inset.hidden) return all;
      const corner = {width: Math.round(this.inset.clientWidth * this.ratio), height: Math.round(this.inset.clientHeight * this.ratio)}, edge = Math.round(8 * this.ratio);
      const other = this.near === "tool" ? "cell" : "tool";
      this.inset.title = `show the ${other}`;
      return [...all, {name: other, box: {...corner, left: this.insetLeft ? edge : width - corner.width - edge, top: edge}}];
    }

    items(reported, truth, colours) {
      const {arm} = this.model, real = truth || reported, made = [{mesh: this.shapes.floor, tint: colours.line, layer: 0}];
      if (this.shapes.piece) made.push({mesh: this.shapes.piece.table, tint: colours.stand, layer: 1}, {mesh: this.shapes.piece.mesh, layer: 2});
      if (this.now === "removed" && this.model.removed) made.push({mesh: this.worn(), lift: true, layer: 3});
      else if (this.path) made.push({mesh: this.path.mesh, lit: false, lift: true, layer: 3, count: this.path.counts[Math.min(this.shown(), this.path.counts.length - 1)]});
      this.tip = real.p;
      this.tool = real.q ? posed(real.p, real.q) : null;
      if (arm && real.joints) {
        this.placed = HilParts.placed(arm, real.joints);
        this.placed.forEach((at, k) => made.push({mesh: this.shapes.links[k], at}));
        this.tip = point(this.placed[6], arm.tip);
      }
      if (this.tool) made.push({mesh: this.shapes.tool, at: this.tool});
      this.apart = truth ? size(minus(reported.p, truth.p)) : 0;
      if (truth && reported.q && this.apart > GHOST_M && !this.isOld) made.push({mesh: this.shapes.tool, at: posed(reported.p, reported.q), tint: colours.ghost, alpha: 0.4});
      const newton = real.push ? size(real.push) : 0;
      if (newton > 0.02 * this.most) {
        const long = real.push.map(one => one * this.perNewton);
        const wide = 0.006 * this.scaleOf(), rim = unit(long).map(one => 0.3 * one * wide), around = plus(long, rim, 3.5);
        made.push({mesh: this.shapes.arrow, at: along(minus(real.p, rim), around, 1.45 * wide), tint: [1, 1, 1], lit: false, over: 1});
        made.push({mesh: this.shapes.arrow, at: along(real.p, long, wide), tint: colours.arrow, lit: true, over: 2});
        this.arrowEnd = plus(real.p, long);
      } else this.arrowEnd = null;
      return made;
    }

    scaleOf() { return this.reach ? this.reach / 0.25 : 1; }

    // ---- path and colours

    shown() { return this.at === null ? Infinity : until(this.places.map(one => one[2]), this.at); }

    domain(values) {
      const sizes = values.map(Math.abs).sort((a, b) => a - b), high = sizes.length ? sizes[Math.floor(0.98 * (sizes.length - 1))] : 1;
      const power = 10 ** Math.floor(Math.log10(high || 1)), most = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10].map(k => k * power).find(one => one >= high * 1.05) || 12 * power;   // room above the usual value
      return this.now === "deviation" ? [-most, most] : [0, most];
    }

    trace(now) {
      const dense = this.tables.path.x.length > 0, cycle = dense ? this.tables.path : this.tables.cycle, touching = cycle.x.map((x, k) => k).filter(k => cycle.touch[k] && cycle.force[k] !== null);
      const {up} = this.model;
      if (this.options.bar && !this.chosen) this.now = this.varies(cycle, touching) ? "deviation" : "force";
      const deviation = this.now === "deviation", value = k => (deviation ? cycle.force[k] - cycle.target[k] : cycle.force[k]);
      const used = touching.filter(k => !deviation || cycle.target[k] !== null), risen = used.filter(k => !deviation || cycle.force[k] > 0.8 * cycle.target[k]);
      const [low, high] = this.range = this.now === "removed" ? [0, this.model.removed.most] : this.domain(risen.map(value));
      const stops = HilPalettes[PAINTS[this.now][2]], true_ = !dense && this.tables.truth.x.length > 1;
      this.places = used.map((k, n) => [true_ ? this.row("truth", cycle.x[k]).p : cycle.p[k], ramp(stops, (value(k) - low) / (high - low)), cycle.x[k], k === used[n - 1] + 1]);
      const width = Math.min(Math.max(2 * this.model.tool.radius, 0.004), 0.012);
      this.path = HilParts.ribbon(this.places, up, width, this.grid && this.grid.height, CUT_M);
      this.most = Math.max(1, ...touching.map(k => Math.abs(cycle.force[k])));
      const all = touching.length ? touching.map(k => cycle.p[k]) : cycle.p.slice(-1), ends = [0, 1, 2].map(k => { const one = all.map(p => p[k]); return [Math.min(...one), Math.max(...one)]; });
      this.centre = ends.map(([a, b]) => (a + b) / 2);
      this.reach = Math.min(Math.max(0.055, 0.55 * size(ends.map(([a, b]) => b - a))), WIDEST);
      this.perNewton = 0.55 * this.reach / this.most;
      if (!this.turned) this.cameras = {};
      this.stale = false; this.drawn = now;
      this.choices();
      this.select.value = this.now;
      this.legend(stops);
    }

    varies(rows, touching) {   // whether the force error after the rise is more than a small share of the target
      const errors = touching.filter(k => rows.target[k] !== null && rows.force[k] > 0.8 * rows.target[k]).map(k => Math.abs(rows.force[k] / rows.target[k] - 1)).sort((a, b) => a - b);
      return errors[Math.floor(0.98 * (errors.length - 1))] > FLAT;
    }

    worn() {
      const {removed} = this.model;
      if (!this.wear) this.wear = HilParts.removed({...removed, level: this.centre[2]}, p => (this.grid ? this.grid.height(p) : null), depth => ramp(HilPalettes.amount, depth / removed.most));
      return this.wear;
    }

    legend(stops) {
      const [name, unit_] = PAINTS[this.now], [low, high] = this.range, bar = element("i"), ticks = element("div", "hil-ticks"), ends = this.now === "removed" ? ["", ""] : [low < 0 ? "≤ " : "", "≥ "];
      bar.style.background = `linear-gradient(to right, ${stops.map(one => `rgb(${one.join()})`).join()})`;
      ticks.append(...[low, (low + high) / 2, high].map((value, k) => element("span", "", `${ends[k / 2] || ""}${digits(value)}`)));
      this.scale.replaceChildren(element("b", "", `${name}, ${unit_}`), bar, ticks);
    }

    label(reported, truth) {
      const {eye, box} = this.views.find(view => view.name === "tool" || this.views.length === 1), push = (truth || reported).push;
      const place = this.arrowEnd && projected(eye, this.arrowEnd, box), left = box.left / this.ratio;
      const newton = push ? size(push) : 0, text = place && place.front ? `${truth ? "true " : ""}${newton.toFixed(newton < 9.995 ? 2 : newton < 99.95 ? 1 : 0)} N` : "";
      this.tag.hidden = !text || (!this.wide && this.near !== "tool");
      if (this.tag.textContent !== text) this.tag.textContent = text;
      const tip = projected(this.views[0].eye, this.tip, this.views[0].box), share = tip.x / this.canvas.width;
      if (!this.inset.hidden && (this.insetLeft ? share < 0.3 : share > 0.4)) {   // the corner without the tool
        this.insetLeft = !this.insetLeft;
        this.inset.classList.toggle("hil-left", this.insetLeft);
        this.soon();
      }
      const most = (this.inset.hidden || this.insetLeft ? this.stage.clientWidth : this.inset.offsetLeft) - this.tag.offsetWidth - 4;
      if (text) {
        const x = place.x / this.ratio, y = Math.round(Math.max(place.y / this.ratio - 12, 4));   // on the arrow's left where the right has no space
        this.tag.style.transform = `translate(${Math.round(Math.max(x + 12 > most ? x - 10 - this.tag.offsetWidth : x + 12, left))}px, ${y}px)`;
      }
      const keys = [["true", truth ? "true tool" : "reported tool"], ["arrow", truth ? "true total force" : "total force"]];
      if (truth) keys.push([this.isOld ? "ghost old" : "ghost", this.isOld ? "no report of the tool" : `reported, ${(this.apart * 1e3).toFixed(2)} mm off`]);
      keys.forEach(([name, words], k) => {
        const span = this.key.children[k] || this.key.appendChild(element("span"));
        if (span.textContent !== words) { span.textContent = words; span.className = name; }
      });
    }

    // ---- camera

    camera(name, box) {
      if (this.cameras[name]) return this.cameras[name];
      const from = Math.atan2(this.centre[1], this.centre[0]), {arm} = this.model, aspect = Math.min(box.width / Math.max(box.height, 1), 1.3);
      if (name === "tool") {
        const target = plus(this.centre, [0, 0, 1], 0.35 * this.reach);
        return (this.cameras.tool = {target, yaw: from - 0.85, pitch: 0.5, distance: 5.4 * this.reach / Math.max(aspect, 0.7), angle: 0.42});
      }
      const span = arm ? arm.axes.slice(1).reduce((sum, axis, k) => sum + size(minus(axis.point, arm.axes[k].point)), 0) : 3 * this.reach;
      const middle = arm ? this.centre.map((one, k) => (k < 2 ? 0.45 * one : 0.36 * span)) : this.centre;
      return (this.cameras.cell = {target: middle, yaw: from - 1.1, pitch: 0.24, distance: (1.75 * span + 0.5 * Math.hypot(this.centre[0], this.centre[1])) / Math.min(Math.max(aspect, 0.7), 1), angle: 0.5});
    }

    orbit(change) {   // turn, shift and zoom the camera
      const {yaw = 0, pitch = 0, factor = 1, right = 0, up = 0, x = Infinity} = change;
      if (!this.views) return;
      const view = this.wide ? this.views[x * this.ratio < this.views[1].box.left ? 0 : 1] : this.views[0];
      const eye = this.cameras[view.name], seen = view.eye;
      eye.yaw -= yaw;
      eye.pitch = Math.min(Math.max(eye.pitch + pitch, -1.45), 1.5);
      eye.distance = Math.min(Math.max(eye.distance * factor, 0.05), 12);
      eye.target = plus(plus(eye.target, seen.right, -right * eye.distance), seen.up, up * eye.distance);
      this.orbited = this.turned = true;
      this.soon();
    }
  }

  return {draw: (place, model, options) => new Cell(place, model, options)};
})();
