/* Clip of a run: turns a page of `hil-bridge view --save` into its frames. See `tools/clip.py`. */
"use strict";
var clip = (() => {
  const make = (tag, id) => Object.assign(document.createElement(tag), {id});
  const caption = make("div", "caption"), panel = make("div", "panel"), later = make("div", "later");
  const charts = Object.values(hilDrawn)[0], point = document.querySelector(".point").textContent;

  function setUp(style, begin, end) {
    const cell = document.querySelector("[data-cell]"), place = document.querySelector("[data-charts]");
    document.head.append(Object.assign(make("style", "clip-style"), {textContent: style}));
    document.body.replaceChildren(caption, cell, place);
    panel.append(make("i"), make("span"));
    cell.append(panel);
    place.append(later);
    showTrueTool();
    enlargeAxes();
    document.querySelector(".hil-title").textContent = "Force, N";
    charts.zoom("time", begin, end);
  }

  function showTrueTool() {   // without the reported one, which is unknown while the tool retracts
    const row = hilCell.row.bind(hilCell);
    hilCell.row = (name, t) => {
      const {p, q} = row("truth", t);
      return {...row(name, t), p, q};
    };
  }

  function enlargeAxes() {
    const x = charts.xAxis.bind(charts), y = charts.yAxis.bind(charts), font = "14px system-ui";
    charts.xAxis = chart => ({...x(chart), font, size: 28, label: undefined});
    charts.yAxis = () => ({...y(), font});
    charts.build();
    Object.assign(charts.charts[0], {first: false, last: false});   // no names of phases, and the unit at the last time
  }

  function show(t, text, pressed, alarm) {
    caption.textContent = text || point;
    caption.className = alarm ? "alarm" : "";
    panel.className = pressed ? "pressed" : "";
    panel.lastChild.textContent = pressed ? "Emergency stop" : "Robot panel";
    charts.charts[0].plot.setSize({width: charts.width(), height: 124});
    hilCell.last = -Infinity;   // the fine picture of a cell that does not move
    hilCell.show(t);
    hilCell.draw(performance.now());
    cover(t);
    return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
  }

  function cover(t) {   // hide what comes later in the chart
    const {plot} = charts.charts[0], over = plot.over.getBoundingClientRect(), top = over.top - later.parentElement.getBoundingClientRect().top;
    const left = over.left + plot.valToPos(t, "x") + 1, px = value => `${value}px`;
    Object.assign(later.style, {left: px(left), top: px(top), width: px(over.right - left + 1), height: px(over.height + 2)});
  }

  return {setUp, show};
})();
