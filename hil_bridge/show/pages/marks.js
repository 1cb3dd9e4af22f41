/* Spans, limits and marks behind and in front of a chart's lines, drawn on its canvas. Used by `charts.js`. */
"use strict";
var HilMarks = (() => {
  const FONT_PX = 11, LONGEST = 70;
  const cut = (ctx, text, room) => {   // truncate a text to the available width
    let end = Math.min(text.length, LONGEST);
    const shown = () => (end < text.length ? text.slice(0, end - 1) + "…" : text);
    while (end > 8 && ctx.measureText(shown()).width > room) end--;
    return shown();
  };

  function inside(u, draw) {
    const {ctx, bbox} = u;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    ctx.font = `${FONT_PX * uPlotRatio(u)}px system-ui, sans-serif`;
    ctx.textBaseline = "top";
    ctx.textAlign = "left";
    draw(ctx, bbox, uPlotRatio(u));
    ctx.restore();
  }

  const uPlotRatio = u => u.ctx.canvas.width / u.width;

  function places(charts, chart, u, box) {   // visible spans, with their ends in px
    const found = [];
    for (const span of charts.spec.spans) {
      if ((span.axis || "time") !== chart.axis) continue;
      const left = u.valToPos(span.begin, "x", true), right = box.left + box.width;
      const to = span.end === null || span.end === undefined ? right : u.valToPos(span.end, "x", true);
      if (to >= box.left && left <= right) found.push({span, left, right: to});
    }
    return found;
  }

  function behind(charts, chart, u) {
    inside(u, (ctx, box, ratio) => {
      for (const {span, left, right} of places(charts, chart, u, box)) {
        const kind = (span.kind || "other").replace(/[^a-z-]/g, "");
        const own = charts.css.getPropertyValue(`--span-${kind}`).trim();
        ctx.fillStyle = own || charts.css.getPropertyValue("--span-other").trim();
        ctx.fillRect(left, box.top, Math.max(right - left, ratio), box.height);
      }
    });
  }

  function names(charts, chart, u, scene) {
    const {ctx, box, ratio} = scene;
    let free = -Infinity;
    ctx.fillStyle = charts.css.getPropertyValue("--quiet").trim();
    for (const {span, left, right} of places(charts, chart, u, box)) {
      if (span.kind === "fault") continue;
      const from = Math.max(left, box.left), to = Math.min(right, box.left + box.width);
      const text = cut(ctx, span.text, Infinity), width = ctx.measureText(text).width, at = (from + to - width) / 2;
      if (width > to - from - 4 * ratio || at < free) continue;
      ctx.fillText(text, at, box.top + 3 * ratio);
      free = at + width + 4 * ratio;
    }
  }

  function plate(charts, scene, [left, top, width]) {   // makes text legible over lines
    const {ctx, ratio} = scene, ink = ctx.fillStyle;
    ctx.fillStyle = charts.css.getPropertyValue("--back").trim();
    ctx.globalAlpha = 0.8;
    ctx.fillRect(left - 2 * ratio, top - ratio, width + 4 * ratio, 13 * ratio);
    ctx.globalAlpha = 1;
    ctx.fillStyle = ink;
  }

  function limit(charts, u, one, scene) {
    const {ctx, box, ratio} = scene;
    const {min, max} = u.scales.y;
    const text = `${one.label} ${String(Number(one.value.toPrecision(5))).replace("-", "−")}`, width = ctx.measureText(text).width;
    const colour = charts.css.getPropertyValue(one.kind === "target" ? "--c-target" : "--c-limit").trim();
    ctx.fillStyle = ctx.strokeStyle = colour;
    ctx.textAlign = "right";
    let right = box.left + box.width - 4 * ratio;
    if (one.value > max || one.value < min) return;   // the title lists it
    const y = u.valToPos(one.value, "y", true);
    ctx.lineWidth = 1.2 * ratio;
    ctx.setLineDash(one.kind === "target" ? [2 * ratio, 3 * ratio] : [7 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(box.left, y);
    ctx.lineTo(box.left + box.width, y);
    ctx.stroke();
    ctx.setLineDash([]);
    const top = y - 14 * ratio < box.top ? y + 2 * ratio : y - 14 * ratio;
    for (const other of scene.labels) if (Math.abs(other.top - top) < 13 * ratio) right = Math.min(right, other.left - 8 * ratio);
    scene.labels.push({top, left: right - width});
    plate(charts, scene, [right - width, top, width]);
    ctx.fillText(text, right, top);
  }

  const LOUD = ["stop", "fault", "note"];
  const kindOf = one => one.kind || "event";

  function ink(charts, one, {ctx}) {
    const colour = charts.css.getPropertyValue(`--mark-${kindOf(one).replace(/[^a-z]/g, "")}`).trim();
    ctx.strokeStyle = ctx.fillStyle = colour || charts.css.getPropertyValue("--mark-event").trim();
  }

  function rule(charts, x, one, scene) {
    const {ctx, box, ratio} = scene, loud = LOUD.includes(kindOf(one));
    ink(charts, one, scene);
    ctx.lineWidth = (loud ? 1.6 : 1) * ratio;
    ctx.globalAlpha = loud ? 1 : 0.55;
    ctx.setLineDash(loud ? [] : [2 * ratio, 3 * ratio]);
    ctx.beginPath();
    ctx.moveTo(x, box.top);
    ctx.lineTo(x, box.top + box.height);
    ctx.stroke();
    ctx.setLineDash([]);
    ctx.globalAlpha = 1;
  }

  function caption(charts, x, one, scene) {
    const {ctx, box, ratio} = scene;
    ink(charts, one, scene);
    const gap = 5 * ratio, text = cut(ctx, one.short || one.text, box.width - 2 * gap), width = ctx.measureText(text).width;
    const leftwards = x + width + 2 * gap > box.left + box.width;
    if (leftwards && 3 * width > box.width) return;   // it would cover the lines before it
    const from = Math.max(leftwards ? x - width - gap : x + gap, box.left + 2 * ratio);
    let row = 0;   // at the bottom, where a pressing force leaves space, and stacked if they would overlap
    while (scene.taken.some(other => other.row === row && from < other.to && from + width > other.from)) row++;
    if (row > 4) return;
    scene.taken.push({row, from: from - gap, to: from + width + gap});
    ctx.textAlign = "left";
    const y = box.top + box.height - (18 + 15 * row) * ratio;
    plate(charts, scene, [from, y, width]);
    ctx.fillText(text, from, y);
  }

  function marks(charts, chart, u, scene) {   // the texts after all lines, so that no line crosses one
    const {box} = scene, placed = charts.spec.marks
      .filter(one => (!one.layer || charts.layers.get(one.layer) !== false) && (one.axis || "time") === chart.axis)
      .map(one => [u.valToPos(one.x, "x", true), one])
      .filter(([x]) => x >= box.left - 1 && x <= box.left + box.width + 1);
    for (const [x, one] of placed) rule(charts, x, one, scene);
    if (chart.first) for (const [x, one] of placed) if (LOUD.includes(kindOf(one))) caption(charts, x, one, scene);
  }

  function moment(charts, u, {ctx, box, ratio}) {
    const x = u.valToPos(charts.moment, "x", true);
    ctx.strokeStyle = charts.css.getPropertyValue("--accent").trim();
    ctx.lineWidth = 2 * ratio;
    ctx.beginPath();
    ctx.moveTo(x, box.top);
    ctx.lineTo(x, box.top + box.height);
    ctx.stroke();
  }

  function before(charts, chart, u) {
    inside(u, (ctx, box, ratio) => {
      const scene = {ctx, box, ratio, taken: [], labels: []};
      if (chart.first) names(charts, chart, u, scene);
      if (Number.isFinite(charts.moment)) moment(charts, u, scene);
      for (const one of chart.spec.limits || []) limit(charts, u, one, scene);
      marks(charts, chart, u, scene);
    });
  }

  return {behind, before};
})();
