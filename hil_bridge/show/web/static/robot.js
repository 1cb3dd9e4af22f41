/* Page of an emulated robot: its live panel. */
"use strict";
(() => {
  const $ = id => document.getElementById(id);
  const token = new URLSearchParams(location.hash.slice(1)).get("token") || "";
  const say = (id, text, look) => { $(id).hidden = !text; $(id).textContent = text; $(id).className = `bar ${look}`; };
  const panel = HilPanel.draw($("robot"), token);
  let tries = 0;

  function take(update) {
    if (update.panel) {
      $("phase").textContent = update.panel.robot;
      document.title = `${update.panel.robot} · hil-bridge`;
      panel.describe(update.panel);
    }
    if (update.panel_state) panel.show(update.panel_state);
  }
  function connect() {
    const socket = new WebSocket(`ws://${location.host}/live`);
    socket.onopen = () => { tries = 0; $("link").textContent = "live"; $("link").className = "live"; say("cut", "", ""); };
    socket.onmessage = event => take(JSON.parse(event.data));
    socket.onclose = () => {
      panel.close();
      $("link").textContent = "connection lost"; $("link").className = "lost";
      say("cut", "Connection lost, trying again … the state below is old", "caution");
      tries += 1;
      setTimeout(connect, Math.min(5000, 300 * 1.6 ** Math.min(tries, 8)));
    };
  }
  connect();
})();
