/* Mouse, touch, wheel and keys turn, shift and zoom the camera of a cell. Used by `cell.js`. */
"use strict";
var HilOrbit = (() => {
  const RAD_PX = 0.008;

  function attach(cell) {
    const {canvas} = cell, fingers = new Map();
    const spot = () => {
      const all = [...fingers.values()], n = all.length, x = all.reduce((sum, p) => sum + p.x, 0) / n, y = all.reduce((sum, p) => sum + p.y, 0) / n;
      return {x, y, wide: n > 1 ? Math.hypot(all[0].x - all[1].x, all[0].y - all[1].y) : 0};
    };
    canvas.addEventListener("pointerdown", event => {
      fingers.set(event.pointerId, {x: event.clientX, y: event.clientY});
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", event => {
      if (!fingers.has(event.pointerId)) return;
      const before = spot(), x = event.clientX - canvas.getBoundingClientRect().left;
      fingers.set(event.pointerId, {x: event.clientX, y: event.clientY});
      const now = spot(), dx = now.x - before.x, dy = now.y - before.y, height = canvas.clientHeight || 1;
      const shifts = fingers.size > 1 || event.shiftKey || event.buttons & 6;
      if (shifts) cell.orbit({x, right: dx / height * 0.62, up: dy / height * 0.62, factor: before.wide && now.wide ? before.wide / now.wide : 1});
      else cell.orbit({x, yaw: dx * RAD_PX, pitch: dy * RAD_PX});
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => fingers.delete(event.pointerId));
    canvas.addEventListener("contextmenu", event => event.preventDefault());
    canvas.addEventListener("wheel", event => {
      if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return;   // else the page scrolls
      event.preventDefault();
      cell.orbit({x: event.clientX - canvas.getBoundingClientRect().left, factor: Math.exp(Math.max(-60, Math.min(60, event.deltaY)) * 0.004)});
    }, {passive: false});
    const reset = () => { cell.cameras = {}; cell.turned = false; cell.soon(); };
    canvas.addEventListener("dblclick", reset);
    canvas.addEventListener("keydown", event => {
      const turns = {ArrowLeft: {yaw: -0.1}, ArrowRight: {yaw: 0.1}, ArrowUp: {pitch: 0.08}, ArrowDown: {pitch: -0.08}};
      const moves = {ArrowLeft: {right: -0.05}, ArrowRight: {right: 0.05}, ArrowUp: {up: -0.05}, ArrowDown: {up: 0.05}};
      const zooms = {"+": {factor: 0.85}, "=": {factor: 0.85}, "-": {factor: 1.18}};
      const change = (event.shiftKey ? moves : turns)[event.key] ?? zooms[event.key];
      if ((!change && event.key !== "0") || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      if (change) cell.orbit(change);
      else reset();
    });
  }

  return {attach};
})();
