/* Panel of an emulated robot: its state, controls and faults, as reported by its process.
   Every text is set as text, never as HTML. */
"use strict";
window.HilPanel = (() => {
  const make = (kind, look, text) => {
    const element = document.createElement(kind);
    if (look) element.className = look;
    if (text !== undefined) element.textContent = text;
    return element;
  };
  const spaced = name => name.replace(/-/g, " ");

  /* Draw a panel in `place`. `token` comes from the URL of the page; without it the panel is read-only. */
  function draw(place, token) {
    const state = make("dl", "state"), controls = make("div", "controls"), faults = make("div", "faults"), said = make("p", "said");
    const hands = make("div", "all"), lamps = new Map(), dials = new Map();   // by control name
    said.setAttribute("role", "status");
    let busy = false;
    const say = (text, failed) => { said.textContent = text; said.className = `said ${failed ? "failed" : ""}`; };

    async function ask(request, done) {
      if (busy) return;
      busy = true;
      try {
        const answer = await fetch("/panel", {method: "POST", headers: {"Content-Type": "application/json", "X-Hil-Bridge-Token": token},
          body: JSON.stringify(request)});
        if (!answer.ok) throw new Error((await answer.text()).trim());
        say(done, false);
      } catch (error) {
        say(`failed: ${error.message}`, true);
      } finally { busy = false; }
    }
    const button = (text, look, act, title) => {
      const made = make("button", look, text);
      made.type = "button";
      made.disabled = !token;
      if (title) made.title = title;
      made.addEventListener("click", act);
      return made;
    };

    function control(name, spec) {
      const row = make("div", "control"), hands = make("div", "hands");
      row.title = spec.meaning;
      const label = make("span", "name", spaced(name));
      row.append(label, hands);
      if (spec.unit === undefined) {
        const positions = new Map();
        for (const to of spec.to) {
          const stops = name === "emergency-stop" && to === "press";
          const made = button(spaced(to), stops ? "danger" : "", () => ask({do: name, to}, `${spaced(name)}: ${spaced(to)}`));
          positions.set(to, made);
          hands.append(made);
        }
        lamps.set(name, positions);
      } else {
        const value = make("input");
        Object.assign(value, {type: "number", min: spec.least, max: spec.greatest, step: "any", value: spec.greatest, disabled: !token});
        value.setAttribute("aria-label", `${spaced(name)}, ${spec.unit}`);
        const act = () => ask({do: name, to: value.value}, `${spaced(name)}: ${value.value} ${spec.unit}`);
        value.addEventListener("keydown", event => { if (event.key === "Enter") act(); });
        hands.append(value, make("span", "quiet", spec.unit), button("set", "", act));
        dials.set(name, value);
      }
      return row;
    }

    function injector(table) {
      const box = make("details"), form = make("div", "injector"), which = make("select"), given = make("div", "given"), meaning = make("p", "quiet");
      which.setAttribute("aria-label", "fault");
      which.disabled = !token;
      for (const [target, named] of Object.entries(table)) {
        const group = make("optgroup");
        group.label = target;
        for (const fault of Object.keys(named)) {
          const option = make("option", "", fault);
          option.value = JSON.stringify([target, fault]);
          group.append(option);
        }
        which.append(group);
      }
      const fields = new Map();
      const choose = () => {
        const [target, fault] = JSON.parse(which.value), spec = table[target][fault];
        meaning.textContent = spec.meaning;
        fields.clear();
        given.replaceChildren();
        for (const [key, parameter] of Object.entries(spec.parameters || {})) {
          const label = make("label"), value = make("input");
          value.placeholder = parameter.default === null || parameter.default === undefined ? "" : String(parameter.default);
          value.title = `${parameter.meaning}, ${parameter.range}`;
          value.disabled = !token;
          label.append(make("span", "", key), value);
          fields.set(key, value);
          given.append(label);
        }
      };
      which.addEventListener("change", choose);
      choose();
      const inject = () => {
        const [target, fault] = JSON.parse(which.value), values = {};
        for (const [key, value] of fields) if (value.value.trim()) values[key] = value.value.trim();
        ask({do: "inject", target, fault, with: values}, `${target}: ${fault}`);
      };
      const hands = make("div", "hands");
      hands.append(button("inject", "", inject), button("mend", "", () => ask({do: "mend"}, "lasting faults ended"), "End all lasting faults."),
        button("disarm", "", () => ask({do: "disarm"}, "armed faults removed"), "Remove all armed faults."));
      form.append(which, meaning, given, hands);
      box.append(make("summary", "", "Faults"), form);
      return box;
    }

    hands.append(controls, said, faults);
    place.replaceChildren(state, hands);
    return {
      close() {   // the panel is no longer connected
        for (const one of place.querySelectorAll("button, input, select")) one.disabled = true;
      },
      describe(spec) {
        lamps.clear(); dials.clear();
        controls.replaceChildren(...Object.entries(spec.controls).map(([name, one]) => control(name, one)));
        if (!token) controls.append(make("p", "quiet", "To operate the panel, open the printed URL with its token."));
        faults.replaceChildren(injector(spec.faults));
        place.hidden = false;
      },
      show({rows, at}) {
        for (const [name, positions] of lamps)
          for (const [to, made] of positions) made.setAttribute("aria-pressed", String(at[name] === to));
        for (const [name, value] of dials) if (document.activeElement !== value) value.value = at[name];
        rows.forEach(([name, text], k) => {
          let dt = state.children[2 * k], dd = state.children[2 * k + 1];
          if (!dd) { dt = make("dt"); dd = make("dd"); state.append(dt, dd); }
          const said = text.replace(/ {2,}/g, "  ").replace(/(^|\s)-(?=\d)/g, "$1−").trim();
          if (dt.textContent !== name) dt.textContent = name;
          if (dd.textContent !== said) dd.textContent = said;
          dd.className = /^not possible|EMERGENCY|emergency/.test(said) ? "bad" : "";
        });
        while (state.children.length > 2 * rows.length) state.lastChild.remove();
      },
    };
  }
  return {draw};
})();
