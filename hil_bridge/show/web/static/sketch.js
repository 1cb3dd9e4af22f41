/* Tool on the surface: side view and 3-D view. Positions are mm from the start point in the robot's base frame.

   const sketch = HilSketch.make(side, space, scale)   two canvases, and an element that displays the scale
   sketch.rows(rows, whole)    columns of cycles and of the truth; `whole` instead of those before
   sketch.show({approach, quaternion, wrench, truth, limit, until})   `until`: x of the last row to draw, or null */
"use strict";
var HilSketch = (() => {
  const KEEP = 3000, LEAST_MM = 12, LEAST_DEEP_MM = 1.5, PIN_PX = 62;
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const plus = (a, b, k) => [a[0] + b[0] * k, a[1] + b[1] * k, a[2] + b[2] * k];
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const size = a => Math.hypot(...a);
  const unit = a => { const l = size(a); return l > 1e-9 ? [a[0] / l, a[1] / l, a[2] / l] : null; };
  const aside = n => unit(cross(n, Math.abs(n[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]));
  const turn = ([w, x, y, z], v) => {
    const t = cross([x, y, z], v).map(one => 2 * one);
    return plus(plus(v, t, w), cross([x, y, z], t), 1);
  };
  const known = list => Array.isArray(list) && list.every(Number.isFinite);

  function made(canvas) {
    const ratio = Math.min(devicePixelRatio || 1, 3), width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const ctx = canvas.getContext("2d");
    ctx.setTransform(ratio, 0, 0, ratio, 0, 0);
    ctx.clearRect(0, 0, width, height);
    ctx.font = "11px system-ui, sans-serif";
    ctx.lineJoin = ctx.lineCap = "round";
    return {ctx, width, height};
  }

  const path = (ctx, points) => { ctx.beginPath(); points.forEach(([x, y], k) => (k ? ctx.lineTo(x, y) : ctx.moveTo(x, y))); };

  function arrow(ctx, from, to, colour) {
    const along = [to[0] - from[0], to[1] - from[1]], length = Math.hypot(...along);
    if (length < 3) return;
    const [ux, uy] = along.map(one => one / length), head = Math.min(9, length / 2);
    ctx.strokeStyle = ctx.fillStyle = colour;
    ctx.lineWidth = 2.5;
    path(ctx, [from, [to[0] - ux * head, to[1] - uy * head]]);
    ctx.stroke();
    path(ctx, [to, [to[0] - ux * head - uy * head / 2, to[1] - uy * head + ux * head / 2],
      [to[0] - ux * head + uy * head / 2, to[1] - uy * head - ux * head / 2]]);
    ctx.fill();
  }

  class Sketch {
    constructor(side, space, scale) {
      this.side = side; this.space = space; this.scale = scale;
      this.tables = {cycle: {x: [], p: [], touch: []}, truth: {x: [], p: []}};
      this.now = null;
      this.yaw = 0.65; this.pitch = 0.42;
      this.frame = 0;
      let held = null;
      space.tabIndex = 0;
      space.addEventListener("pointerdown", event => { held = [event.clientX, event.clientY]; space.setPointerCapture(event.pointerId); });
      space.addEventListener("pointermove", event => {
        if (!held) return;
        this.yaw += (event.clientX - held[0]) * 0.01;
        this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + (event.clientY - held[1]) * 0.01));
        held = [event.clientX, event.clientY];
        this.soon();
      });
      for (const name of ["pointerup", "pointercancel"]) space.addEventListener(name, () => { held = null; });
      space.addEventListener("keydown", event => {
        const by = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1]}[event.key];
        if (!by) return;
        event.preventDefault();
        this.yaw += by[0]; this.pitch += by[1];
        this.soon();
      });
      new ResizeObserver(() => this.soon()).observe(side);
      matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.soon());
    }

    rows(rows, whole) {
      for (const [name, table] of Object.entries(this.tables)) {
        if (whole) for (const list of Object.values(table)) list.length = 0;
        const added = rows[name];
        if (!added) continue;
        added.x.forEach((x, k) => {
          const p = [added.position_x[k], added.position_y[k], added.position_z[k]];
          if (!known(p)) return;
          table.x.push(x); table.p.push(p);
          if (table.touch) table.touch.push(added.in_contact[k] === 1);
        });
        if (!whole && table.x.length > KEEP) for (const list of Object.values(table)) list.splice(0, list.length - KEEP);
      }
    }

    show(now) { this.now = now; this.soon(); }

    soon() { if (!this.frame) this.frame = requestAnimationFrame(() => { this.frame = 0; this.draw(); }); }

    upTo(table) {   // the rows up to the displayed moment
      const until = this.now.until;
      if (until === null || until === undefined) return table.x.length;
      let low = 0, high = table.x.length;
      while (low < high) { const middle = (low + high) >> 1; if (table.x[middle] <= until) low = middle + 1; else high = middle; }
      return low;
    }

    draw() {
      if (!this.now || !known(this.now.approach)) return;
      this.css = getComputedStyle(document.documentElement);
      this.ends = {cycle: this.upTo(this.tables.cycle), truth: this.upTo(this.tables.truth)};
      this.drawSide();
      this.drawSpace();
    }

    colour(name) { return this.css.getPropertyValue(`--${name}`).trim(); }

    tip(name) { const end = this.ends[name]; return end ? this.tables[name].p[end - 1] : null; }

    forceInBase() {
      const {quaternion, wrench} = this.now;
      return known(quaternion) && known(wrench) ? turn(quaternion, wrench.slice(0, 3)) : null;
    }

    along(n) {   // distance of the tool across the approach
      const {p} = this.tables.cycle, end = this.ends.cycle;
      if (end > 1) {
        const way = plus(p[end - 1], p[0], -1), across = plus(way, n, -dot(way, n));
        if (size(across) > 0.5) return unit(across);
      }
      return aside(n);
    }

    drawSide() {
      const {ctx, width, height} = made(this.side), n = this.now.approach, t = this.along(n);
      const trail = name => this.tables[name].p.slice(0, this.ends[name]).map(p => [dot(p, t), dot(p, n)]);
      const reported = trail("cycle"), truth = trail("truth"), touching = this.tables.cycle.touch.slice(0, this.ends.cycle);
      if (!reported.length) return;
      const floor = reported.filter((_, k) => touching[k]);
      const seen = floor.length > 1 ? floor : reported.slice(-40), tip = reported[reported.length - 1];
      const xs = [...seen.map(p => p[0]), tip[0]], zs = seen.map(p => p[1]);
      const spread = (low, high, least) => { const more = Math.max(0, least - (high - low)) / 2; return [low - more, high + more]; };
      const [x0, x1] = spread(Math.min(...xs), Math.max(...xs), LEAST_MM);
      const [z0, z1] = spread(Math.min(...zs), Math.max(...zs), LEAST_DEEP_MM);
      const top = PIN_PX + 34, sx = (width - 56) / (x1 - x0), sz = Math.min((height - top - 34) / (z1 - z0), sx * 40);
      const at = ([x, z]) => [28 + (x - x0) * sx, top + (z - z0) * sz];
      const times = sz / sx;
      this.scale.textContent = times > 1.3 ? `depth × ${times < 10 ? times.toFixed(1) : Math.round(times)}` : "";
      const ground = floor.map(at);
      if (ground.length > 1) {
        const sorted = ground.slice().sort((a, b) => a[0] - b[0]);
        path(ctx, [[0, sorted[0][1]], ...sorted, [width, sorted[sorted.length - 1][1]], [width, height], [0, height]]);
        ctx.fillStyle = this.colour("line");
        ctx.globalAlpha = 0.55; ctx.fill(); ctx.globalAlpha = 1;
      }
      ctx.lineWidth = 1.4;
      if (truth.length > 1) { ctx.strokeStyle = this.colour("c-truth"); path(ctx, truth.map(at)); ctx.stroke(); }
      ctx.strokeStyle = this.colour("c2"); path(ctx, reported.map(at)); ctx.stroke();
      this.level(ctx, at, {width, n, t, sx, sz});
      const place = [at(tip)[0], Math.max(Math.min(at(tip)[1], height - 6), PIN_PX + 6)];
      if (truth.length) this.pin(ctx, [at(truth[truth.length - 1])[0] + 13, Math.max(Math.min(at(truth[truth.length - 1])[1], height - 6), PIN_PX + 6)], this.colour("c-truth"), 0.5);
      this.pin(ctx, place, this.colour("c2"), 1);
      const force = this.forceInBase();
      if (force) {
        const px = 46 / Math.max(this.now.limit || 50, 1), to = [place[0] + dot(force, t) * px * 1.6, place[1] + dot(force, n) * px * 1.6];
        arrow(ctx, place, to, this.colour("c3"));
        ctx.fillStyle = this.colour("text");
        const label = `${size(force).toFixed(1)} N`;
        const left = place[0] - 12 - ctx.measureText(label).width;   // the true tool is on the right
        ctx.fillText(label, left > 2 ? left : Math.min(place[0] + 24, width - 46), Math.max(place[1] - 20, 12));
      }
      this.ruler(ctx, sx, height, this.colour("quiet"));
    }

    level(ctx, at, {width, n, t, sx, sz}) {   // the true surface below the tool
      const truth = this.now.truth, tip = this.tip("truth");
      if (!truth || !known(truth.normal) || !tip) return;
      const slope = -dot(truth.normal, t) / (dot(truth.normal, n) || -1), [x, z] = at([dot(tip, t), dot(tip, n)]);
      const rise = slope * sz / sx, reach = Math.min(60, width / 5);
      if (!truth.force || !size(truth.force)) return;
      ctx.strokeStyle = this.colour("text"); ctx.lineWidth = 2;
      path(ctx, [[x - reach, z - reach * rise], [x + reach, z + reach * rise]]);
      ctx.stroke();
    }

    pin(ctx, [x, y], colour, alpha) {
      ctx.globalAlpha = alpha; ctx.fillStyle = colour;
      path(ctx, [[x, y], [x - 6, y - 16], [x - 6, y - PIN_PX], [x + 6, y - PIN_PX], [x + 6, y - 16]]);
      ctx.fill(); ctx.globalAlpha = 1;
    }

    ruler(ctx, scale, height, colour) {
      const wanted = 60 / scale, power = 10 ** Math.floor(Math.log10(wanted));
      const length = [1, 2, 5, 10].map(k => k * power).find(one => one >= wanted) || wanted;
      ctx.strokeStyle = ctx.fillStyle = colour; ctx.lineWidth = 1.5;
      path(ctx, [[12, height - 10], [12 + length * scale, height - 10]]); ctx.stroke();
      ctx.fillText(`${Number(length.toPrecision(2))} mm`, 12, height - 15);
    }

    drawSpace() {
      const {ctx, width, height} = made(this.space), n = this.now.approach, table = this.tables.cycle;
      const tip = this.tip("cycle");
      if (!tip) return;
      const up = n.map(one => -one), u = this.along(n), v = cross(up, u);
      const cos = Math.cos(this.yaw), sin = Math.sin(this.yaw), cp = Math.cos(this.pitch), sp = Math.sin(this.pitch);
      const points = table.p.slice(Math.max(0, this.ends.cycle - 1500), this.ends.cycle);
      const touch = table.touch.slice(Math.max(0, this.ends.cycle - 1500), this.ends.cycle);
      const floor = points.filter((_, k) => touch[k]), fitted = floor.length > 1 ? floor : [tip];
      const middle = [0, 1, 2].map(k => (Math.min(...fitted.map(p => p[k])) + Math.max(...fitted.map(p => p[k]))) / 2);
      const reach = Math.max(25, ...fitted.map(p => size(plus(p, middle, -1))), Math.min(60, size(plus(tip, middle, -1)))) * 1.25;
      const scale = Math.min(width, height * 1.35) / 2 / reach;
      const at = p => {
        const d = plus(p, middle, -1), a = dot(d, u), b = dot(d, v), c = dot(d, up);
        const right = a * cos - b * sin, deep = a * sin + b * cos;
        return [width / 2 + right * scale, height * 0.64 - (c * cp + deep * sp) * scale];
      };
      this.ground(ctx, at, {middle, u, v, reach});
      const truth = this.now.truth, truly = this.tip("truth");
      ctx.lineWidth = 1.6;
      if (floor.length > 1) { ctx.strokeStyle = this.colour("c1"); path(ctx, floor.map(at)); ctx.stroke(); }
      const length = reach * 0.75;
      const body = (where, q, colour, alpha) => {
        if (!known(q)) return;
        const axis = turn(q, [0, 0, -1]), foot = at(where), neck = at(plus(where, axis, length * 0.22)), head = at(plus(where, axis, length));
        ctx.globalAlpha = alpha; ctx.strokeStyle = colour; ctx.lineWidth = 3;
        path(ctx, [foot, neck]); ctx.stroke();
        ctx.lineWidth = 11; ctx.lineCap = "butt"; path(ctx, [neck, head]); ctx.stroke(); ctx.lineCap = "round"; ctx.globalAlpha = 1;
      };
      if (truth && truly) {
        if (known(truth.normal) && size(truth.force)) this.tile(ctx, at, truly, truth.normal, reach);
        body(truly, truth.quaternion, this.colour("c-truth"), 0.5);
      }
      body(tip, this.now.quaternion, this.colour("c2"), 0.95);
      const force = this.forceInBase();
      if (force) arrow(ctx, at(tip), at(plus(tip, force, reach * 0.9 / Math.max(this.now.limit || 50, 1))), this.colour("c3"));
      this.ruler(ctx, scale, height, this.colour("quiet"));
    }

    ground(ctx, at, {middle, u, v, reach}) {
      ctx.strokeStyle = this.colour("grid"); ctx.lineWidth = 1;
      for (let k = -3; k <= 3; k++) {
        const d = k / 3 * reach;
        path(ctx, [at(plus(plus(middle, u, d), v, -reach)), at(plus(plus(middle, u, d), v, reach))]); ctx.stroke();
        path(ctx, [at(plus(plus(middle, v, d), u, -reach)), at(plus(plus(middle, v, d), u, reach))]); ctx.stroke();
      }
    }

    tile(ctx, at, place, normal, reach) {
      const a = aside(normal), b = cross(normal, a), half = reach * 0.35;
      path(ctx, [[1, 1], [1, -1], [-1, -1], [-1, 1]].map(([i, k]) => at(plus(plus(place, a, i * half), b, k * half))));
      ctx.closePath(); ctx.fillStyle = this.colour("c5"); ctx.globalAlpha = 0.3; ctx.fill(); ctx.globalAlpha = 1;
    }
  }

  return {make: (side, space, scale) => new Sketch(side, space, scale)};
})();
