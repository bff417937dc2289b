"use strict";
// Plays an estimate, and where it is public the reference, on the plans of all levels.
const replay = (() => {
  const { svg, html, digits } = draw;
  const SPEEDS = [1, 4, 16, 64];

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

  // What is said of a moment.
  function words(estimate, reference, time) {
    const row = rowAt(estimate, time);
    const said = [`${time.toFixed(0)} s`];
    said.push(row < 0 ? "no estimate yet" : `estimate on level ${estimate.level[row]}`);
    const real = reference ? rowAt(reference, time) : -1;
    if (row >= 0 && real >= 0) {
      const off = Math.hypot(estimate.x_m[row] - reference.x_m[real], estimate.y_m[row] - reference.y_m[real]);
      const isRight = estimate.level[row] === reference.level[real];
      said.push(`about ${digits(off)} m off${isRight ? "" : ", on the wrong level"}`);
    }
    return said.join(" · ");
  }

  // Builds the player into a node. `plans` and `tracks` as the files have them.
  function player(node, plans, tracks, name) {
    const walks = Object.keys(tracks);
    if (!walks.length) {
      node.replaceChildren(html("p", {}, "There is no walk to replay."));
      return;
    }
    const options = walks.map((walk, i) => html("option", { value: walk }, `${i + 1}: ${walk}`));
    const walk = html("select", { id: "replay-walk" }, ...options);
    const speed = html("select", {}, ...SPEEDS.map((times) => html("option", { value: times, selected: times === 16 }, `${times} ×`)));
    const play = html("button", { type: "button", id: "play" }, "Play");
    const scrubber = html("input", { type: "range", min: 0, step: "any", "aria-label": "time", id: "scrubber" });
    const told = html("output", { id: "told" });
    const stage = html("div", { class: "levels" });
    const key = html("p", { class: "small" });
    const controls = html("div", { class: "controls" }, play, scrubber, html("label", {}, "walk ", walk), html("label", {}, "speed ", speed));
    node.replaceChildren(controls, told, stage, key);

    let scene = null;
    let timer = null;

    function go(time) {
      const at = Math.min(Math.max(time, 0), scene.end);
      scrubber.value = at;
      show(scene.estimateMarks, scene.estimate, at);
      if (scene.reference) show(scene.referenceMarks, scene.reference, at);
      told.textContent = words(scene.estimate, scene.reference, at);
      scrubber.setAttribute("aria-valuetext", told.textContent);
      scene.now = at;
    }

    function stop() {
      clearTimeout(timer);
      timer = null;
      play.textContent = "Play";
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

    function load() {
      stop();
      const facts = plans.walks[walk.value] || { building: "" };
      const estimate = tracks[walk.value];
      const reference = facts.reference || null;
      const panels = plan.panels(plans.buildings[facts.building] || null, reference ? [estimate, reference] : [estimate]);
      stage.replaceChildren(...panels.map((panel) => panel.figure));
      const referenceMarks = reference ? marks(panels, "real") : [];
      const end = Math.max(estimate.t_s.at(-1) || 0, reference ? reference.t_s.at(-1) : 0, 1e-3);
      scene = { estimate, reference, referenceMarks, estimateMarks: marks(panels, "a"), end, now: 0 };
      scrubber.max = end;
      key.replaceChildren(
        html("span", { class: "key" }, html("span", { class: "swatch a" }), name),
        reference ? html("span", { class: "key" }, html("span", { class: "swatch real" }), "where the walker was") : "",
      );
      go(end);
    }

    play.addEventListener("click", () => (timer === null ? run() : stop()));
    scrubber.addEventListener("input", () => {
      stop();
      go(Number(scrubber.value));
    });
    walk.addEventListener("change", load);
    load();
  }

  return { player, rowAt, trail, words };
})();
