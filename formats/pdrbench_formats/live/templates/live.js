"use strict";
// Shows phones that stream. What is drawn, and how, is that of replay.js.

const FLAT = [[1, 0, 0], [0, 1, 0]];
const NEAR_M = 30;
const RETRY_MS = 1000;
const MIN_DRAG_PX = 12; // less is a tap: the heading is not known

function lively(walk) {
  const find = (id) => document.getElementById(id);
  const canvas = find("plan");
  const state = { phones: new Map(), socket: null, drag: null, isSetting: false, drawing: null };
  for (const level of walk.levels) find("level").add(new Option("level " + level.level, level.level));

  const phone = () => state.phones.get(find("phone").value);
  const place = (one) => (one && one.trail.length ? one.trail[one.trail.length - 1] : null);
  const isSetting = () => Boolean(phone()) && (state.isSetting || phone().state === "tap where you are");

  function shownLevel() {
    if (find("level").value !== "") return Number(find("level").value);
    const at = place(phone());
    return at ? at[2] : walk.levels.reduce((best, one) => (Math.abs(one.level) < Math.abs(best) ? one.level : best), walk.levels[0].level);
  }

  function take(message) {
    for (const frame of message.phones) {
      const before = state.phones.get(frame.device);
      const trail = before && before.walk === frame.walk ? before.trail.slice(0, frame.from) : [];
      state.phones.set(frame.device, { ...frame, trail: trail.concat(frame.trail) });
      if (![...find("phone").options].some((one) => one.value === frame.device)) {
        find("phone").add(new Option(frame.name, frame.device));
      }
    }
    draw();
  }

  function draw() {
    const { context, ratio, width, height } = sized(canvas.parentElement);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    context.lineJoin = context.lineCap = "round";
    const one = phone();
    const at = place(one);
    const level = shownLevel();
    const isNear = at && find("show").value === "near" && !isSetting();
    const drawing = isNear ? around(at[0], at[1], NEAR_M * Math.max(1, width / height), width, height) : fit(FLAT, corners(walk), width, height);
    state.drawing = drawing;
    drawBuilding(context, walk, walk.levels.filter((each) => each.level === level), drawing);
    if (one) {
      const shown = (row) => row[2] === level;
      if (one.dots) drawDots(context, walk, decodeCloud(one.dots), 0, (index) => walk.levels[index].level === level, drawing, 3);
      drawRuns(context, runs(one.trail, shown, drawing), ESTIMATE, 2.5, []);
      if (at) drawEstimate(context, at, one.disc_m, !shown(at), drawing);
    }
    if (state.drag) drawArrow(context, state.drag);
    drawScale(context, drawing, height);
    tell(one, at);
    canvas.dataset.time = one && one.t_s !== null ? one.t_s : "";
  }

  function drawArrow(context, drag) {
    context.beginPath();
    trace(context, [drag.from, drag.to]);
    context.strokeStyle = "#d55e00";
    context.lineWidth = 4;
    context.stroke();
    context.beginPath();
    context.arc(...drag.from, 7, 0, 2 * Math.PI);
    context.fillStyle = "#d55e00";
    context.fill();
  }

  function tell(one, at) {
    const wish = "tap where you are, and drag into the direction of travel";
    find("says").textContent = one ? (isSetting() ? wish : one.state) : "waiting for a phone";
    find("set").setAttribute("aria-pressed", String(isSetting()));
    find("end").disabled = !one || one.state !== "walking";
    find("why").textContent = one ? one.why : "";
    const facts = [];
    if (one && one.t_s !== null) facts.push(["time", one.t_s.toFixed(1) + " s"]);
    if (at) facts.push(["level", String(at[2])], ["x, y", at[0].toFixed(1) + ", " + at[1].toFixed(1) + " m"]);
    if (one && one.disc_m !== null) facts.push(["95 % within", one.disc_m.toFixed(1) + " m"]);
    if (one && one.num_dots !== null) facts.push(["particles", one.num_dots.toLocaleString("en")]);
    for (const [why, count] of Object.entries(one ? one.dropped : {})) facts.push(["left out, " + why, String(count)]);
    find("facts").replaceChildren(...facts.map(([name, text]) => tableRow(name, text)));
  }

  function send(wish) {
    if (state.socket && state.socket.readyState === WebSocket.OPEN) state.socket.send(JSON.stringify(wish));
  }

  function pixel(event) {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  canvas.addEventListener("pointerdown", (event) => {
    if (!isSetting()) return;
    canvas.setPointerCapture(event.pointerId);
    state.drag = { from: pixel(event), to: pixel(event) };
    draw();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!state.drag) return;
    state.drag.to = pixel(event);
    draw();
  });
  canvas.addEventListener("pointerup", () => {
    if (!state.drag) return;
    const { from, to } = state.drag;
    const [u0, v0] = state.drawing.place(0, 0, 0);
    const [du, dv] = [to[0] - from[0], from[1] - to[1]];
    const heading = Math.hypot(du, dv) < MIN_DRAG_PX ? null : (Math.atan2(dv, du) * 180) / Math.PI;
    const xy = [(from[0] - u0) / state.drawing.scale, (v0 - from[1]) / state.drawing.scale];
    send({ device: find("phone").value, xy_m: xy, level: shownLevel(), heading_deg: heading });
    state.drag = null;
    state.isSetting = false;
    draw();
  });
  find("set").addEventListener("click", () => { state.isSetting = !state.isSetting; draw(); });
  find("end").addEventListener("click", () => send({ device: find("phone").value }));
  for (const id of ["phone", "level", "show"]) find(id).addEventListener("change", draw);
  window.addEventListener("resize", draw);

  function connect() {
    state.socket = new WebSocket(new URL("view", location.href.replace(/^http/, "ws")));
    state.socket.addEventListener("message", (event) => take(JSON.parse(event.data)));
    state.socket.addEventListener("close", () => {
      find("says").textContent = "the server is gone; trying again …";
      setTimeout(connect, RETRY_MS);
    });
  }
  connect();
  draw();
}

fetch("plan").then((answer) => answer.json()).then(lively);
