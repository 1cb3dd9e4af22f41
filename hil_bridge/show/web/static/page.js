/* Page of a run: displays the server's updates. Every text is set as text, never as HTML. */
"use strict";
(() => {
  const $ = id => document.getElementById(id);
  const token = new URLSearchParams(location.hash.slice(1)).get("token") || "";
  const KEEP_S = 120, FOLLOW_S = 30, QUIET_MS = 4000, EVENTS = 200, KEEP_ROWS = 6000;
  let charts = null, cell = null, scene = null, socket = null, tries = 0, receivedAt = 0, over = false, playback = null;

  const fixed = (value, digits, unit) => (Number.isFinite(value) ? `${value.toFixed(digits)}${unit ? ` ${unit}` : ""}` : "–");
  const signed = (value, digits, unit) => {   // a value that rounds to 0 has no sign
    if (!Number.isFinite(value)) return "–";
    const size = Math.abs(value).toFixed(digits);
    return `${Number(size) === 0 ? "" : value < 0 ? "−" : "+"}${size} ${unit}`;
  };
  const set = (element, text) => { if (element.textContent !== text) element.textContent = text; };
  const bar = (id, text, lead) => {
    const element = $(id);
    element.hidden = !text;
    if (!text || element.dataset.text === text + lead) return;
    element.dataset.text = text + lead;
    element.replaceChildren();
    if (lead) { const b = document.createElement("b"); b.textContent = lead; element.append(b); }
    element.append(text);
  };
  const list = (id, pairs) => {
    const element = $(id);
    pairs.forEach(([name, value, look], k) => {
      let dt = element.children[2 * k], dd = element.children[2 * k + 1];
      if (!dd) { dt = document.createElement("dt"); dd = document.createElement("dd"); element.append(dt, dd); }
      set(dt, name); set(dd, value);
      if (dd.className !== (look || "")) dd.className = look || "";
    });
    while (element.children.length > 2 * pairs.length) element.lastChild.remove();
  };

  function begin(update) {
    scene = update.scene;
    playback = update.playback || null;
    const name = $("cell"), word = scene.cell || "–";
    name.replaceChildren(word);
    const small = document.createElement("small");
    small.textContent = scene.devices;
    if (scene.devices) name.append(small);
    name.className = scene.real ? "real" : "emulated";
    document.title = `${word} · hil-bridge`;
    if (charts) charts.destroy();
    charts = HilCharts.draw($("charts"), update.charts, playback ? {} : {keep: KEEP_S, follow: FOLLOW_S});
    if (cell) cell.destroy();
    cell = HilCell.draw($("drawn"), update.model, {bar: false, keep: playback ? Infinity : KEEP_ROWS});
    $("list").replaceChildren();
    const foot = $("foot");
    foot.replaceChildren(scene.record ? "Recording: " : "No recording is kept.");
    if (scene.record) { const code = document.createElement("code"); code.textContent = scene.record; foot.append(code); }
    if (playback) {
      $("slider").hidden = false;
      $("at").min = playback.begin; $("at").max = playback.end;
    } else foot.append(` · Foxglove connects to ws://${location.host}`);
    window.hilPage = {charts, cell, scene};   // for tests
  }

  function margin(name, value, limit, unit) {
    const row = document.querySelector(`[data-margin="${name}"]`), share = Number.isFinite(value) && limit > 0 ? Math.abs(value) / limit : 0;
    row.className = `margin${share >= 0.8 ? " most" : share >= 0.5 ? " half" : ""}`;
    row.querySelector("b").style.width = `${Math.min(100, share * 100)}%`;
    set(row.querySelector("em"), Number.isFinite(value) ? `${Math.abs(value).toFixed(1)} of ${limit} ${unit}` : `– of ${limit} ${unit}`);
  }

  function numbers(now) {
    const phase = $("phase");
    set(phase, now.cause ? "stopped" : now.phase);
    phase.className = now.cause ? "stopped" : now.phase;
    set($("step"), now.step ? `step ${now.step} of ${scene.steps.length}: ${now.step_label}` : "");
    $("held").hidden = !now.held;
    set($("elapsed"), fixed(now.elapsed_s, 1, "s"));
    set($("remaining"), now.remaining_s === null || now.cause ? "" : `${fixed(now.remaining_s, 0, "s")} to track`);
    set($("force"), fixed(now.force, 2));
    set($("target"), now.wants_force ? fixed(now.target, 2, "N") : "none, in free space");
    const off = now.force - now.target, part = Math.abs(off) / Math.max(Math.abs(now.target), 1e-9);
    const deviation = $("off");
    if (!Number.isFinite(now.force)) { set(deviation, "–"); deviation.className = ""; }
    else if (!now.in_contact) { set(deviation, "no contact"); deviation.className = "away"; }
    else { set(deviation, `off by ${signed(off, 2, "N")}`); deviation.className = part < 0.1 ? "near" : part < 0.3 ? "away" : "far"; }
    const pulls = now.force < 0;
    set(document.querySelector('[data-margin="force"] span'), pulls ? "pull limit" : "force limit");
    margin("force", now.force, pulls ? scene.limits.pull : scene.limits.force, "N");
    margin("resultant", now.resultant, scene.limits.resultant, "N");
    margin("moment", now.moment, scene.limits.moment, "N·m");
    const [, , , mx, my, mz] = now.wrench || [];
    list("across", [["lateral force", fixed(now.lateral, 2, "N")], ["mx", signed(mx, 3, "N·m")], ["my", signed(my, 3, "N·m")], ["mz", signed(mz, 3, "N·m")]]);
    list("motion", [["depth, reported", fixed(now.depth_mm, 3, "mm")], ["depth, commanded", fixed(now.commanded_mm, 3, "mm")],
      ["correction", signed(now.correction_mm, 3, "mm") + (now.resting ? " in dead band" : "")], ["travel", fixed(now.travel_mm, 1, "mm")],
      ["stiffness", Number.isFinite(now.stiffness) ? `${Math.round(now.stiffness).toLocaleString("en")} N/m` : "–"],
      now.cause ? ["supervisor", "the run is stopped", "bad"]   // the last cycle's verdict no longer applies
        : now.phase === "end" ? ["supervisor", "the run has ended"]
        : ["supervisor", now.verdict ? [now.verdict, ...(now.reasons || [])].join(": ") : "–", now.verdict === "stop" ? "bad" : now.verdict === "clamp" ? "warn" : now.verdict ? "good" : ""]]);
    const latency = now.latency;
    list("times", [["cycle", fixed(now.cycle_ms, 1, "ms")],
      scene.streamed ? ["answer", `${fixed(now.answer_ms, 2, "ms")}, ${now.late} late`, now.late ? "warn" : ""] : ["line floor", fixed(scene.floor_ms, 1, "ms")],
      ["sensor age", fixed(now.age_ms, 1, "ms"), now.age_ms > scene.limits.stale_ms ? "bad" : now.age_ms > 100 ? "warn" : ""],
      ["latency p50", latency ? fixed(latency.p50_ms, 1, "ms") : "–"], ["latency p99", latency ? fixed(latency.p99_ms, 1, "ms") : "–"]]);
    const troubles = Object.entries(now.troubles || {}).map(([name, count]) => `${name} ${count}`).join(", ");
    const counted = count => [count === null ? "–" : String(count), count === null ? "" : count ? "warn" : "good"];
    const scope = playback ? ", full run" : "";
    const lines = [[`link errors${scope}`, ...counted(now.link_errors)], [`frames lost${scope}`, ...counted(now.frames_lost)]];
    for (const [what, sent, received] of now.traffic || []) lines.push([what, `${sent} sent, ${received} received`]);
    if (now.dropped) lines.push(["not displayed", `${now.dropped} records`, "warn"]);
    if (troubles) lines.push(["errors", troubles, "wide warn"]);
    if (now.zero || now.check) lines.push(["sensor", now.zero || now.check, "wide"]);
    list("health", lines);
  }

  function events(rows, whole) {
    const place = $("list");
    if (whole) place.replaceChildren();
    for (const row of rows) {
      const item = document.createElement("li"), time = document.createElement("time"), text = document.createElement("span"), kind = document.createElement("b");
      time.textContent = fixed(row.at, 1, "s");
      kind.textContent = row.kind;
      text.append(kind, ` ${row.text}`);
      item.className = row.weight;
      item.append(time, text);
      place.prepend(item);
    }
    while (place.children.length > EVENTS) place.lastChild.remove();
  }

  function ended(end, cause) {
    const outcomes = {completed: "Completed", stopped: "Stopped", interrupted: "Ended by the operator", gone: "The run ended unexpectedly"};
    const outcome = $("outcome"), lines = [end.cause, ...end.followed.map(text => `Then: ${text}`)];
    bar("left", end.left && " ", end.left && `Tool ${end.left}`);
    $("left").className = `bar ${end.retracted === false ? "alarm" : ""}`;
    const why = lines.filter(Boolean).join("\n");
    bar("outcome", why || " ", (outcomes[end.outcome] || end.outcome) + (why && ":"));
    outcome.className = `bar ${end.outcome === "completed" ? "good" : end.outcome === "interrupted" ? "caution" : "alarm"}`;
    if (!cause || end.cause === cause) $("cause").hidden = true;
    set($("link"), playback ? "recording" : "the run has ended");
    $("link").className = "";
    $("end").hidden = true;
    panel.close();
    if (!playback) { over = true; bar("cut", "", ""); bar("silent", "", ""); }
  }

  const panel = HilPanel.draw($("robot-panel"), token);

  function take(update) {
    receivedAt = performance.now();
    if (update.panel) { panel.describe(update.panel); $("hands").hidden = false; }
    if (update.panel_state) panel.show(update.panel_state);
    if (update.scene) begin(update);
    if (!scene) return;
    const now = update.now;
    if (now) numbers(now);
    if (update.rows) { charts.append(update.rows); cell.rows(update.rows, update.start); }
    if (update.marks) for (const mark of update.marks) charts.mark(mark);
    if (update.spans) charts.spans(update.spans);
    if (update.events) events(update.events, update.events_whole);
    if (now) {
      bar("cause", now.cause, "Stopped:");
      bar("warning", now.warning, "Warning:");
      bar("silent", now.silent_s ? `no data from the run for ${now.silent_s.toFixed(0)} s` : "", "");
      cell.show(update.at === undefined ? null : update.at);
    }
    if (update.end) ended(update.end, now && now.cause);
    if (playback && update.at !== undefined) playing.arrived(update.at);
  }

  function connect() {
    socket = new WebSocket(`ws://${location.host}/live`);
    socket.onopen = () => {
      tries = 0; receivedAt = performance.now();
      scene = null; over = false;
      set($("link"), "live"); $("link").className = "live"; $("cause").hidden = true;
      bar("cut", "", "");
      $("outcome").hidden = $("left").hidden = true;
      $("end").hidden = !token; $("end").disabled = false;
    };
    socket.onmessage = event => take(JSON.parse(event.data));
    socket.onclose = event => {
      $("end").disabled = true;
      if (!over) {
        set($("link"), "connection lost"); $("link").className = "lost";
        bar("cut", `trying again${event.reason ? ` (${event.reason})` : ""} … the values below are old`, "Connection lost,");
      }
      tries += 1;
      setTimeout(connect, Math.min(5000, 300 * 1.6 ** Math.min(tries, 8)));
    };
  }

  setInterval(() => {   // an open connection without messages
    if (!over && !playback && socket && socket.readyState === WebSocket.OPEN && performance.now() - receivedAt > QUIET_MS) socket.close();
  }, 1000);

  $("end").addEventListener("click", () => $("sure").showModal());
  $("sure").addEventListener("close", async () => {
    if ($("sure").returnValue !== "yes") return;
    $("end").disabled = true;
    try {
      const answer = await fetch("/end", {method: "POST", headers: {"Content-Type": "application/json", "X-Hil-Bridge-Token": token},
        body: JSON.stringify({do: "retract and end"})});
      if (!answer.ok) throw new Error(await answer.text());
      bar("said", "requested: retract and end", "");
    } catch (error) {
      bar("said", `failed: ${error.message}`, "");
      $("end").disabled = false;
    }
  });

  // playback of a recording

  const playing = {
    timer: 0, waits: false, pending: null,
    go(at) {
      this.pending = at;
      set($("at-told"), fixed(at, 2, "s"));
      if (!this.waits && socket && socket.readyState === WebSocket.OPEN) { this.waits = true; socket.send(JSON.stringify({at})); this.pending = null; }
    },
    arrived(at) {
      this.waits = false;
      charts.here(at);
      if (this.pending !== null) this.go(this.pending);
      else if (document.activeElement !== $("at") || this.timer) { $("at").value = at; set($("at-told"), fixed(at, 2, "s")); }
    },
    toggle() {
      if (this.timer) { clearInterval(this.timer); this.timer = 0; set($("play"), "▶"); return; }
      if (Number($("at").value) >= playback.end) $("at").value = playback.begin;
      set($("play"), "❚❚");
      let before = performance.now();
      this.timer = setInterval(() => {
        const present = performance.now(), at = Math.min(playback.end, Number($("at").value) + (present - before) / 1e3);
        before = present;
        $("at").value = at;
        this.go(at);
        if (at >= playback.end) this.toggle();
      }, 60);
    },
  };
  $("at").addEventListener("input", () => playing.go(Number($("at").value)));
  $("play").addEventListener("click", () => playing.toggle());

  connect();
})();
