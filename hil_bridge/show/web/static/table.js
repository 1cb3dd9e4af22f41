/* The page of a campaign's results: takes the server's news and shows them. Every text is set as text. */
"use strict";
(() => {
  const $ = id => document.getElementById(id);
  let tries = 0;
  const cell = (row, text, look) => {
    const made = document.createElement("td");
    made.textContent = text;
    if (look) made.className = look;
    row.append(made);
  };
  const fill = (id, rows, make) => $(id).replaceChildren(...rows.map(one => {
    const row = document.createElement("tr");
    make(row, one);
    return row;
  }));
  const run = (row, one) => {
    for (const text of [one.key, one.seed, one.cell, one.fault || "none"]) cell(row, text);
    cell(row, one.outcome + (one.cause ? `: ${one.cause}` : ""), one.passed ? "good" : "bad");
    cell(row, one.force === null ? "–" : one.force.toFixed(1));
    cell(row, one.failed, "bad");
  };
  function take(told) {
    const done = told.passed + told.failed;
    $("name").textContent = `Campaign ${told.name}`;
    document.title = `${done} of ${told.count} · ${told.name}`;
    $("done").textContent = `${done} of ${told.count} runs done`;
    $("counts").textContent = `${told.passed} passed, ${told.failed} failed`;
    $("file").textContent = told.file;
    $("trouble").hidden = !told.trouble;
    $("trouble").textContent = told.trouble;
    for (const [id, count] of [["good", told.passed], ["bad", told.failed]]) $(id).style.width = `${(100 * count) / Math.max(told.count, 1)}%`;
    fill("cases", told.cases, (row, one) => { cell(row, one.cell); cell(row, one.fault || "none"); cell(row, one.passed); cell(row, one.failed, one.failed ? "bad" : ""); });
    fill("worst", told.worst, run);
    fill("newest", told.newest, run);
  }
  function connect() {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.onopen = () => { tries = 0; $("link").textContent = "live"; $("link").className = ""; };
    socket.onmessage = event => take(JSON.parse(event.data));
    socket.onclose = () => {
      $("link").textContent = "connection lost, trying again"; $("link").className = "lost";
      tries += 1;
      setTimeout(connect, Math.min(5000, 300 * 1.6 ** Math.min(tries, 8)));
    };
  }
  connect();
})();
