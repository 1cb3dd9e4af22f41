/* Touch, shift+drag and wheel on a chart pan and zoom every chart of its axis. Used by `charts.js`. */
"use strict";
var HilPointer = (() => {
  function attach(charts, chart) {
    const over = chart.plot.over, fingers = new Map();
    let begun = null;
    const start = () => {
      const view = charts.view(chart.axis), points = [...fingers.values()];
      begun = points.length ? {view, points} : null;
    };
    const to = () => {
      const [low, high] = begun.view, width = over.clientWidth, now = [...fingers.values()];
      const value = px => low + (high - low) * px / width;
      if (now.length > 1 && begun.points.length > 1) {
        const [a, b] = begun.points, factor = Math.abs(a - b) / Math.max(Math.abs(now[0] - now[1]), 8);
        const middle = value((a + b) / 2), left = (now[0] + now[1]) / 2 / width, span = (high - low) * factor;
        charts.place_(chart.axis, middle - span * left, middle + span * (1 - left));
      } else {
        const shift = value(begun.points[0]) - value(now[0]);
        charts.place_(chart.axis, low + shift, high + shift);
      }
    };
    const x = event => event.clientX - over.getBoundingClientRect().left;
    over.addEventListener("pointerdown", event => {
      if (event.pointerType !== "touch" && !event.shiftKey) return;
      fingers.set(event.pointerId, x(event));
      over.setPointerCapture(event.pointerId);
      start();
    });
    over.addEventListener("mousedown", event => { if (event.shiftKey) event.stopImmediatePropagation(); }, true);
    over.addEventListener("pointermove", event => {
      if (!fingers.has(event.pointerId)) return;
      fingers.set(event.pointerId, x(event));
      if (begun) to();
    });
    const end = event => { if (fingers.delete(event.pointerId)) start(); };
    over.addEventListener("pointerup", end);
    over.addEventListener("pointercancel", end);
    over.addEventListener("wheel", event => {
      const [low, high] = charts.view(chart.axis);
      if (event.ctrlKey || event.metaKey) {
        const factor = Math.exp(Math.max(-50, Math.min(50, event.deltaY)) * 0.01), at = low + (high - low) * x(event) / over.clientWidth;
        event.preventDefault();
        charts.place_(chart.axis, at - (at - low) * factor, at + (high - at) * factor);
      } else if (Math.abs(event.deltaX) > Math.abs(event.deltaY) && charts.views[chart.axis]) {
        const shift = (high - low) * event.deltaX / over.clientWidth;
        event.preventDefault();
        charts.place_(chart.axis, low + shift, high + shift);
      }
    }, {passive: false});
  }

  return {attach};
})();
