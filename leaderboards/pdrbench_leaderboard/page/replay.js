"use strict";
// Plays estimates, and where it is public the reference, on the plans of all levels. Walk, time and what is shown are in
// the address, so that a moment can be passed on.
const replay = (() => {
  const { svg, html, digits } = draw;
  const SPEEDS = [1, 4, 16, 64];
  const SIDES = ["a", "b", "c", "d", "e", "f"]; // colours and dashes: so many estimates at once

  // The last row of a track not later than a time; -1 before the first.
  function rowAt(track, time) {
    let low = -1;
    let high = track.t_s.length;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (track.t_s[middle] <= time) low = middle;
      else high = middle;
    }
    return low;
  }

  // The part of a track up to a row that lies on a level, as a path; it breaks where the level changes.
  function trail(track, row, level) {
    let text = "";
    let isDrawing = false;
    for (let i = 0; i <= row; i++) {
      const here = track.level[i] === level;
      if (here) text += `${isDrawing ? "L" : "M"}${track.x_m[i]} ${-track.y_m[i]}`;
      isDrawing = here;
    }
    return text;
  }

  // What is shown of one track: a trail and a dot on every panel.
  function marks(panels, side) {
    return panels.map((panel) => {
      const line = svg("path", { class: `trail ${side}` });
      const dot = svg("circle", { class: `here ${side}`, r: panel.unit * 1.1, visibility: "hidden" });
      panel.layer.append(line, dot);
      return { level: panel.level, line, dot };
    });
  }

  function show(shown, track, time) {
    const row = rowAt(track, time);
    for (const mark of shown) {
      const isHere = row >= 0 && track.level[row] === mark.level;
      mark.line.setAttribute("d", trail(track, row, mark.level));
      mark.dot.setAttribute("visibility", isHere ? "visible" : "hidden");
      if (isHere) {
        mark.dot.setAttribute("cx", track.x_m[row]);
        mark.dot.setAttribute("cy", -track.y_m[row]);
      }
    }
    return row;
  }

  // What is said of one estimate at a moment.
  function words(estimate, reference, time) {
    const row = rowAt(estimate, time);
    const said = [row < 0 ? "no estimate yet" : `estimate on level ${estimate.level[row]}`];
    const real = reference ? rowAt(reference, time) : -1;
    if (row >= 0 && real >= 0) {
      const off = Math.hypot(estimate.x_m[row] - reference.x_m[real], estimate.y_m[row] - reference.y_m[real]);
      const isRight = estimate.level[row] === reference.level[real];
      said.push(`about ${digits(off)} m off${isRight ? "" : ", on the wrong level"}`);
    }
    return said.join(" · ");
  }

  // What an address asks for: {walk, t, with: slugs}; nothing where it asks for nothing.
  function asked(hash) {
    const query = new URLSearchParams(hash.replace(/^#/, ""));
    const time = Number(query.get("t"));
    return { walk: query.get("walk"), t: query.has("t") && time >= 0 ? time : null, with: query.getAll("with") };
  }

  // Builds the player into a node. `plans` and `tracks` as the files have them; `others` lists {slug, name, label}, and
  // `fetchTracks` promises the tracks of one.
  function player(node, plans, tracks, name, others = [], fetchTracks = null) {
    const walks = Object.keys(tracks);
    if (!walks.length) {
      node.replaceChildren(html("p", {}, "There is no walk to replay."));
      return;
    }
    const shown = [{ name, tracks, side: SIDES[0], slug: null }];
    const options = walks.map((walk, i) => html("option", { value: walk }, `${i + 1}: ${walk}`));
    const walk = html("select", { id: "replay-walk" }, ...options);
    const speed = html("select", {}, ...SPEEDS.map((times) => html("option", { value: times, selected: times === 16 }, `${times} ×`)));
    const play = html("button", { type: "button", id: "play" }, "Play");
    const scrubber = html("input", { type: "range", min: 0, step: "any", "aria-label": "time", id: "scrubber" });
    const told = html("output", { id: "told" });
    const stage = html("div", { class: "levels" });
    const key = html("p", { class: "small", id: "replay-key" });
    const beside = html("select", { id: "replay-with" });
    const link = html("a", { id: "replay-link", href: "#" }, "link to this moment");
    const controls = html("div", { class: "controls" }, play, scrubber, html("label", {}, "walk ", walk), html("label", {}, "speed ", speed));
    if (others.length) controls.append(html("label", {}, "beside it ", beside));
    node.replaceChildren(controls, told, stage, key, html("p", { class: "small" }, link));

    let scene = null;
    let timer = null;
    const wanted = asked(location.hash);
    let isAddressed = wanted.walk !== null; // whoever only looked at the page keeps its plain address

    // The address of what is shown. Not while it plays: browsers count changes of an address.
    function remember() {
      const query = new URLSearchParams({ walk: walk.value, t: scene.now.toFixed(1) });
      for (const one of shown.slice(1)) query.append("with", one.slug);
      link.href = `#${query}`;
      if (timer !== null || !isAddressed) return;
      try {
        history.replaceState(null, "", `#${query}`);
      } catch {
        // some browsers forbid it for files
      }
    }

    function go(time) {
      const at = Math.min(Math.max(time, 0), scene.end);
      scrubber.value = at;
      const said = scene.actors.map((actor) => {
        show(actor.marks, actor.track, at);
        const text = words(actor.track, scene.reference, at);
        return scene.actors.length > 1 ? `${actor.name}: ${text}` : text;
      });
      if (scene.reference) show(scene.referenceMarks, scene.reference, at);
      told.textContent = [`${at.toFixed(0)} s`, ...said].join(" · ");
      scrubber.setAttribute("aria-valuetext", told.textContent);
      scene.now = at;
      remember();
    }

    function stop() {
      clearTimeout(timer);
      timer = null;
      play.textContent = "Play";
      if (scene) remember();
    }

    // Smoothly, or once a second where the reader asked for little motion.
    function run() {
      if (scene.now >= scene.end) go(0);
      play.textContent = "Pause";
      const pause = matchMedia("(prefers-reduced-motion: reduce)").matches ? 1000 : 33;
      let last = performance.now();
      const frame = () => {
        const now = performance.now();
        go(scene.now + ((now - last) / 1000) * Number(speed.value));
        last = now;
        if (scene.now >= scene.end) stop();
        else timer = setTimeout(frame, pause);
      };
      timer = setTimeout(frame, pause);
    }

    // One entry of the key; whoever was added can be taken away again.
    function legend(one) {
      const parts = [html("span", { class: `swatch ${one.side}` }), one.name];
      if (one.slug !== null) {
        const away = html("button", { type: "button", class: "away", "aria-label": `remove ${one.name}` }, "×");
        away.addEventListener("click", () => {
          shown.splice(shown.indexOf(one), 1);
          load(scene.now);
        });
        parts.push(away);
      }
      return html("span", { class: "key" }, ...parts);
    }

    // Who else can be shown.
    function offer() {
      const left = others.filter((other) => !shown.some((one) => one.slug === other.slug));
      const rest = left.map((other) => html("option", { value: other.slug }, `${other.label} · ${other.name}`));
      beside.replaceChildren(html("option", { value: "" }, "none"), ...rest);
      beside.disabled = shown.length >= SIDES.length;
    }

    // Draws the walk that is chosen; at its end where no time is given.
    function load(time) {
      stop();
      const facts = plans.walks[walk.value] || { building: "" };
      const here = shown.filter((one) => one.tracks[walk.value]);
      const reference = facts.reference || null;
      const every = here.map((one) => one.tracks[walk.value]).concat(reference ? [reference] : []);
      const panels = plan.panels(plans.buildings[facts.building] || null, every);
      stage.replaceChildren(...panels.map((panel) => panel.figure));
      const referenceMarks = reference ? marks(panels, "real") : [];
      const actors = here.map((one) => ({ name: one.name, track: one.tracks[walk.value], marks: marks(panels, one.side) }));
      const end = Math.max(1e-3, ...every.map((track) => track.t_s.at(-1) || 0));
      scene = { actors, reference, referenceMarks, end, now: 0 };
      scrubber.max = end;
      key.replaceChildren(
        ...shown.map(legend),
        reference ? html("span", { class: "key" }, html("span", { class: "swatch real" }), "where the walker was") : "",
      );
      offer();
      go(time ?? end);
    }

    // Adds another entry; the colour is the first that is free.
    async function add(slug) {
      const other = others.find((one) => one.slug === slug);
      const side = SIDES.find((free) => !shown.some((one) => one.side === free));
      if (!other || !side || shown.some((one) => one.slug === slug)) return;
      const one = { name: other.name, slug, side, tracks: {} };
      shown.push(one);
      try {
        one.tracks = await fetchTracks(slug);
      } catch (error) {
        shown.splice(shown.indexOf(one), 1);
        told.textContent = `${other.name} cannot be shown: ${error.message}.`;
        return;
      }
      load(scene.now);
    }

    play.addEventListener("click", () => (timer === null ? run() : stop()));
    scrubber.addEventListener("input", () => {
      stop();
      go(Number(scrubber.value));
    });
    walk.addEventListener("change", () => load());
    beside.addEventListener("change", () => add(beside.value));
    controls.addEventListener("input", () => { isAddressed = true; }, true);
    controls.addEventListener("click", () => { isAddressed = true; }, true);
    if (walks.includes(wanted.walk)) walk.value = wanted.walk;
    load(wanted.walk === walk.value ? wanted.t : null);
    for (const slug of wanted.with) add(slug);
  }

  return { player, asked, rowAt, trail, words };
})();
