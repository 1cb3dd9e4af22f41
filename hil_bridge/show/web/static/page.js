/* Page of a run: displays the server's updates. Every text is set as text, never as HTML. */
"use strict";
(() => {
  const $ = id => document.getElementById(id);
  const token = new URLSearchParams(location.hash.slice(1)).get("token") || "";
  const KEEP_S = 120, FOLLOW_S = 30, FIRST = 3, QUIET_MS = 4000, EVENTS = 200, STILL_S = 1, KEEP_ROWS = 6000, ROUNDED = 1e-4;
  const OUTCOMES = {completed: ["completed", ""], stopped: ["stopped", "alarm"], interrupted: ["ended by the operator", "caution"], gone: ["lost", "alarm"]};
  let charts = null, cell = null, scene = null, socket = null, tries = 0, receivedAt = 0, over = false, playback = null;
  let end = null, said = [];   // how the run ended, if the page shows its end; sentences with which the page begins

  const rounded = (value, digits) => {   // at most three significant digits
    const whole = Math.abs(value) < 1 ? 0 : Math.floor(Math.log10(Math.abs(value))) + 1;
    return Math.abs(value).toFixed(Math.max(0, Math.min(digits, 3 - whole)));
  };
  const fixed = (value, digits, unit, plus = "") => {   // a value that rounds to 0 has no sign
    if (!Number.isFinite(value)) return "–";
    const size = rounded(value, digits);
    return `${Number(size) === 0 ? "" : value < 0 ? "−" : plus}${size}${unit ? ` ${unit}` : ""}`;
  };
  const signed = (value, digits, unit) => fixed(value, digits, unit, "+");
  const sentence = text => text && `${text[0].toUpperCase()}${text.slice(1)}${/[.!?]$/.test(text) ? "" : "."}`;
  const made = (tag, text, name) => {
    const element = document.createElement(tag);
    if (text) element.textContent = text;
    if (name) element.className = name;
    return element;
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
    if (scene.devices) name.append(made("small", scene.devices));
    name.className = scene.real ? "real" : "emulated";
    if (charts) charts.destroy();
    charts = HilCharts.draw($("charts"), update.charts, {first: FIRST, ...(playback ? {} : {keep: KEEP_S, follow: FOLLOW_S})});
    if (cell) cell.destroy();
    cell = HilCell.draw($("drawn"), update.model, {bar: false, keep: playback ? Infinity : KEEP_ROWS});
    $("list").replaceChildren();
    const foot = $("foot");
    foot.replaceChildren(scene.record ? "Recording: " : "No recording is kept.");
    if (scene.record) foot.append(made("code", scene.record));
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
    set(row.querySelector("em"), `${fixed(Math.abs(value), 1)} of ${limit} ${unit}`);
  }

  function numbers(now) {
    const phase = $("phase");
    const [word, look] = end ? OUTCOMES[end.outcome] || [end.outcome, ""] : now.cause ? OUTCOMES.stopped : [now.phase, now.phase];
    set(phase, word);
    phase.className = look;
    const leaving = Boolean(now.cause) || now.phase === "retract";
    document.body.classList.toggle("leaving", leaving);
    document.title = [...(end ? [word] : []), scene.cell || "–", "hil-bridge"].join(" · ");
    set($("step"), now.step ? `step ${now.step} of ${scene.steps.length}: ${now.step_label}` : "");
    $("held").hidden = !now.held;
    set($("elapsed"), now.stopped_s === null ? fixed(now.elapsed_s, 1, "s") : `at ${fixed(now.stopped_s, 1, "s")}`);
    set($("remaining"), now.remaining_s === null || leaving || end ? "" : `${fixed(now.remaining_s, 0, "s")} left`);
    set($("force"), fixed(now.force, 2));
    set($("target"), now.wants_force ? fixed(now.target, 2, "N") : "none");
    const off = now.force - now.target, part = Math.abs(off) / Math.max(Math.abs(now.target), 1e-9);
    const deviation = $("off");
    if (!Number.isFinite(now.force)) { set(deviation, "–"); deviation.className = ""; }
    else if (!now.in_contact) { set(deviation, "no contact"); deviation.className = "away"; }
    else { set(deviation, `off by ${signed(off, 2, "N")}${now.resting ? ", within the dead band" : ""}`); deviation.className = part < 0.1 ? "near" : part < 0.3 ? "away" : "far"; }
    const pulls = now.force < 0;
    set(document.querySelector('[data-margin="force"] span'), pulls ? "pull limit" : "force limit");
    margin("force", now.force, pulls ? scene.limits.pull : scene.limits.force, "N");
    margin("resultant", now.resultant, scene.limits.resultant, "N");
    margin("moment", now.moment, scene.limits.moment, "N·m");
    const [, , , mx, my, mz] = now.wrench || [];
    list("across", [["lateral force", fixed(now.lateral, 2, "N")], ["mx, my, mz", now.wrench ? `${[mx, my, mz].map(one => fixed(one, 3)).join("\u2002")}\u00a0N·m` : "–"]]);
    list("motion", [["depth, reported", fixed(now.depth_mm, 3, "mm")], ["depth, commanded", fixed(now.commanded_mm, 3, "mm")],
      ["correction", now.resting ? "0 mm, dead band" : signed(now.correction_mm, 3, "mm")], ["travel", fixed(now.travel_mm, 1, "mm")],
      ["stiffness", Number.isFinite(now.stiffness) ? `${Number(now.stiffness.toPrecision(3)).toLocaleString("en").replace(/,/g, "\u202f")} N/m` : "–"],
      ...(now.cause || end || now.phase === "end" ? []   // the last cycle's verdict no longer applies
        : [["supervisor", now.verdict ? [now.verdict, ...(now.reasons || [])].join(": ") : "–", now.verdict === "stop" ? "bad" : now.verdict === "clamp" ? "warn" : now.verdict ? "good" : ""]])]);
    const latency = now.latency;
    list("times", [["cycle", fixed(now.cycle_ms, 1, "ms")],
      scene.streamed ? ["answer", `${fixed(now.answer_ms, 2, "ms")}, ${now.late} late`, now.late ? "warn" : ""] : ["line floor", fixed(scene.floor_ms, 1, "ms")],
      ["sensor age", fixed(now.age_ms, 1, "ms"), now.age_ms > scene.limits.stale_ms ? "bad" : now.age_ms > 0.8 * scene.limits.stale_ms ? "warn" : ""],
      [`${latency?.name ?? "latency"}, p50`, latency ? fixed(latency.p50_ms, 1, "ms") : "–"], ["p99", latency ? fixed(latency.p99_ms, 1, "ms") : "–"]]);
    const troubles = Object.entries(now.troubles || {}).map(([name, count]) => `${name} ${count}`).join(", ");
    const counted = count => [count === null ? "–" : String(count), count === null ? "" : count ? "warn" : "good"];
    const scope = playback ? ", full run" : "";
    const lines = [[`link errors${scope}`, ...counted(now.link_errors)], [`frames lost${scope}`, ...counted(now.frames_lost)]];
    for (const [what, sent, received] of now.traffic || []) lines.push([what, `${sent} out, ${received} in`]);
    if (now.dropped) lines.push(["not displayed", `${now.dropped} records`, "warn"]);
    if (troubles) lines.push(["disturbances", troubles, "warn"]);
    const check = now.zero || now.check, listed = [...$("list").children].some(one => one.dataset.text === check);
    if (check && !listed) lines.push(["sensor", check, "wide"]);
    list("health", lines);
  }

  function events(rows, whole) {
    const place = $("list");
    if (whole) place.replaceChildren();
    for (const row of rows) {
      const item = made("li", "", row.weight), text = made("span");
      text.append(made("b", row.kind), ` ${row.text}`);
      item.append(made("time", `${row.at.toFixed(1)} s`), text);
      Object.assign(item.dataset, {kind: row.kind, text: row.text, cause: row.cause});
      place.prepend(item);
    }
    for (const item of place.children) {
      const {kind, text} = item.dataset;
      if (kind === "stop" || said.some(one => text.startsWith(one))) set(item.lastChild, `${kind}: ${[item.dataset.cause, "see above"].filter(Boolean).join(", ")}`);
    }
    while (place.children.length > EVENTS) place.lastChild.remove();
    const retraction = charts.spec.spans.filter(one => one.kind === "retract").at(-1);   // its label tells a failed one
    const begun = retraction && [...place.children].find(one => one.dataset.kind === "phase" && one.dataset.text === "retract");
    if (begun) set(begun.lastChild.lastChild, ` ${retraction.text}`);
    clip();
  }

  function clip() {   // the list displays complete rows, and counts those below
    const place = $("list"), end = place.scrollTop + place.clientHeight, ends = [...place.children].map(one => one.offsetTop - place.offsetTop + one.offsetHeight);
    const whole = ends.filter(one => one <= end + 1), more = ends.length - whole.length;
    place.style.clipPath = more ? `inset(0 0 ${Math.max(0, end - Math.max(0, ...whole))}px 0)` : "";
    $("below").hidden = !more && place.scrollHeight <= place.clientHeight;
    set($("below"), more ? `${more} more` : "");
  }
  $("list").addEventListener("scroll", clip);
  new ResizeObserver(clip).observe($("list"));

  function ended(how) {   // what happened, and what comes next
    const outcome = $("outcome"), lines = how.lines.map(([text, style]) => made("p", text, style));
    said = how.repeats;
    if (playback) lines[0].prepend("At the end: ");
    $("why").replaceChildren(...lines);
    $("next").replaceChildren(...how.next.map(([purpose, command]) => {
      const row = made("div", "", "command"), copy = made("button", "Copy");
      copy.type = "button"; copy.dataset.copy = ""; copy.setAttribute("aria-label", `copy: ${command}`);
      row.append(made("span", purpose), made("code", command), copy);
      return row;
    }));
    outcome.className = `bar end ${how.style}`;
    outcome.hidden = false;
    $("foot").hidden = how.next.length > 0;   // the commands name the recording
    set($("link"), playback ? "recording" : "the run has ended");
    $("link").className = "";
    $("end").hidden = true;
    panel.close();
    if (!playback) { over = true; charts.follow(null); for (const id of ["cut", "silent", "said", "still"]) bar(id, "", ""); }
  }

  const panel = HilPanel.draw($("robot-panel"), token);

  function take(update) {
    receivedAt = performance.now();
    if (update.panel) { panel.describe(update.panel); $("hands").hidden = false; }
    if (update.panel_state) panel.show(update.panel_state);
    if (update.scene) begin(update);
    if (!scene) return;
    const now = update.now;
    if (update.end && $("outcome").hidden) ended(update.end);
    end = update.end && (!playback || update.at >= playback.end * (1 - ROUNDED)) ? update.end : null;
    document.body.classList.toggle("ended", Boolean(end));
    document.body.classList.toggle("empty", Boolean(end) && now?.cycle === undefined);
    if (update.rows) { charts.append(update.rows); cell.rows(update.rows, update.start); }
    if (update.marks) for (const mark of update.marks) charts.mark(mark);
    if (update.spans) charts.spans(update.spans);
    if (update.events) events(update.events, update.events_whole);
    if (now) {
      numbers(now);
      const last = cell.tables.cycle.x.at(-1), still = !playback && now.phase === "retract" && now.elapsed_s - last > STILL_S;
      document.body.classList.toggle("still", still);
      bar("cause", update.end ? "" : sentence(now.cause), "");
      bar("still", still && !update.end ? `This retraction has no cycles: values and picture are those of the last cycle, at ${fixed(last, 1, "s")}; the chart of the force continues.` : "", "");
      bar("warning", now.warning, "Warning:");
      bar("silent", now.silent_s ? `no data from the run for ${now.silent_s.toFixed(0)} s` : "", "");
      cell.show(update.at === undefined ? null : update.at);
    }
    if (playback && update.at !== undefined) playing.arrived(update.at);
  }

  function connect() {
    socket = new WebSocket(`ws://${location.host}/live`);
    socket.onopen = () => {
      tries = 0; receivedAt = performance.now();
      scene = null; over = false; said = [];
      set($("link"), "live"); $("link").className = "live"; $("cause").hidden = true;
      bar("cut", "", "");
      $("outcome").hidden = true; $("foot").hidden = false;
      document.body.classList.remove("old", "ended", "empty");
      $("end").hidden = !token; $("end").disabled = false;
    };
    socket.onmessage = event => take(JSON.parse(event.data));
    socket.onclose = event => {
      $("end").disabled = true;
      if (over) return;   // the server has ended with the run
      set($("link"), "no connection"); $("link").className = "lost";
      document.body.classList.add("old");
      bar("cut", `Trying to connect${event.reason ? ` (${event.reason})` : ""} …${scene ? " The values below are old." : ""}`, "");
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
