/* Served report page: displays its body whenever the server sends it. A campaign's page may change. */
"use strict";
(() => {
  const $ = id => document.getElementById(id);
  let tries = 0;
  const open = () => [...document.querySelectorAll("details[open][id]")].map(one => one.id);
  const scrolled = () => [...document.querySelectorAll(".scroll")].map(one => [one.scrollLeft, one.scrollTop]);
  function take(update) {
    const opened = open(), places = scrolled();
    document.title = update.title;
    $("file").textContent = update.file;
    $("trouble").hidden = !update.trouble;
    $("trouble").textContent = update.trouble;
    if (update.still) $("link").textContent = "";
    if (update.body !== undefined) $("body").innerHTML = update.body;   // by our own renderer, which escapes every text
    for (const place of document.querySelectorAll("[data-charts]"))
      HilCharts.draw(place, JSON.parse($(place.dataset.charts).textContent));
    for (const id of opened) if ($(id)) $(id).open = true;
    document.querySelectorAll(".scroll").forEach((one, k) => { if (places[k]) [one.scrollLeft, one.scrollTop] = places[k]; });
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
