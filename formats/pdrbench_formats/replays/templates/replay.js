"use strict";
// Plays a walk. Everything that does not depend on the page is a function of its arguments; `start` ties them to it.

const SPEEDS = [0.25, 0.5, 1, 2, 4, 8];
const ESTIMATE = "#0072b2";
const REFERENCE = "#111111";

// Bytes of base64 text.
function bytes(text) {
  const raw = atob(text);
  const array = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) array[i] = raw.charCodeAt(i);
  return array;
}

// The particles of all frames: places are three whole numbers each, marks one byte.
function decodeCloud(cloud) {
  const packed = bytes(cloud.places);
  const view = new DataView(packed.buffer);
  const places = new Uint16Array(packed.length / 2);
  for (let i = 0; i < places.length; i++) places[i] = view.getUint16(2 * i, true);
  return { first: cloud.first, places, marks: bytes(cloud.marks) };
}

// Particle i as {x, y, z, level (place in the list of levels), dead}.
function dotAt(walk, cloud, i) {
  const size = (axis) => (walk.high[axis] - walk.low[axis]) / 65535;
  const along = (axis) => walk.low[axis] + cloud.places[3 * i + axis] * size(axis);
  return { x: along(0), y: along(1), z: along(2), level: cloud.marks[i] & 127, dead: cloud.marks[i] >= 128 };
}

// A drawing that maps metres of the building to pixels: u = scale (m00 x + m01 y + m02 z) + left, v downwards.
function fit(matrix, corners, width, height) {
  const project = (x, y, z) => [0, 1].map((row) => matrix[row][0] * x + matrix[row][1] * y + matrix[row][2] * z);
  const drawn = corners.map((corner) => project(...corner));
  const low = [0, 1].map((axis) => Math.min(...drawn.map((place) => place[axis])));
  const high = [0, 1].map((axis) => Math.max(...drawn.map((place) => place[axis])));
  const pad = 12;
  const scale = Math.max(
    1e-6,
    Math.min((width - 2 * pad) / (high[0] - low[0]), (height - 2 * pad) / (high[1] - low[1])),
  );
  const left = (width - scale * (low[0] + high[0])) / 2;
  const base = (height + scale * (low[1] + high[1])) / 2;
  return {
    scale,
    place: (x, y, z) => {
      const [u, v] = project(x, y, z);
      return [left + scale * u, base - scale * v];
    },
  };
}

// A plan with a place in its middle.
function around(x, y, widthM, width, height) {
  const scale = width / widthM;
  return { scale, place: (px, py) => [width / 2 + scale * (px - x), height / 2 - scale * (py - y)] };
}

// Corners of the building, at the height of its lowest and highest floor.
function corners(walk) {
  const [x0, y0] = walk.low;
  const [x1, y1] = walk.high;
  const heights = walk.levels.map((level) => level.height_m);
  const found = [];
  for (const z of [Math.min(...heights), Math.max(...heights)])
    for (const [x, y] of [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]) found.push([x, y, z]);
  return found;
}

// The last estimate up to frame k; null before the first.
function lastEstimate(walk, k) {
  for (let i = k; i >= 0; i--) if (walk.frames.estimate[i]) return walk.frames.estimate[i];
  return null;
}

// Estimates up to frame k; null where one is missing, or is a guess while several clusters stand.
function trail(walk, k) {
  const { estimate, converged } = walk.frames;
  return estimate.slice(0, k + 1).map((row, i) => (converged[i] === false ? null : row));
}

// What a frame says: pairs of name and text.
function words(walk, k) {
  const f = walk.frames;
  const said = [["time", f.t_s[k].toFixed(1) + " s"]];
  said.push(["level", f.estimate[k] ? String(f.estimate[k][2]) : "no estimate"]);
  if (f.particles[k] !== null) said.push(["particles", f.particles[k].toLocaleString("en")]);
  if (f.clusters[k] !== null) said.push(["clusters", String(f.clusters[k])]);
  if (f.converged[k] !== null) said.push(["converged", f.converged[k] ? "yes" : "no"]);
  if (f.error_m[k] !== null) {
    said.push(["error", f.error_m[k].toFixed(2) + " m" + (f.level_right[k] ? "" : ", on the wrong level")]);
  }
  return said;
}

// Runs of a path that stay where `shown` holds, as lists of pixels.
function runs(rows, shown, drawing) {
  const found = [];
  let run = [];
  for (const row of rows) {
    if (row && row[3] !== null && shown(row)) {
      run.push(drawing.place(row[0], row[1], row[3]));
    } else if (run.length) {
      found.push(run);
      run = [];
    }
  }
  if (run.length) found.push(run);
  return found;
}

const player = { bytes, decodeCloud, dotAt, fit, around, corners, lastEstimate, trail, words, runs };

function trace(context, pixels) {
  pixels.forEach(([u, v], i) => (i ? context.lineTo(u, v) : context.moveTo(u, v)));
}

function ringPixels(flat, height, drawing) {
  const pixels = [];
  for (let i = 0; i < flat.length; i += 2) pixels.push(drawing.place(flat[i], flat[i + 1], height));
  return pixels;
}

// Levels from the lowest to the highest, and above them their stairs.
function drawBuilding(context, walk, levels, drawing) {
  for (const level of levels) drawPart(context, walk, level.floors, drawing);
  for (const level of levels) drawPart(context, walk, level.stairs, drawing);
}

function drawPart(context, walk, part, drawing) {
  const { risers, treads, walls } = part;
  context.beginPath();
  for (let i = 0; i < risers.length; i += 6) {
    const [x0, y0, x1, y1, z, over] = risers.slice(i, i + 6);
    trace(context, [[x0, y0, z], [x1, y1, z], [x1, y1, z + over], [x0, y0, z + over]].map((p) => drawing.place(...p)));
  }
  context.fillStyle = walk.colours.riser;
  context.fill();
  for (const floor of part.rings) {
    context.beginPath();
    for (const ring of floor.rings) {
      trace(context, ringPixels(ring, floor.height_m, drawing));
      context.closePath();
    }
    context.fillStyle = context.strokeStyle = walk.colours.floors[floor.kind];
    context.fill();
    context.lineWidth = 0.6; // closes the hairline between neighbours
    context.stroke();
  }
  for (const [lines, colour, width] of [[treads, walk.colours.tread, 0.5], [walls, walk.colours.wall, 0.9]]) {
    context.beginPath();
    for (let i = 0; i < lines.length; i += 5) {
      const [x0, y0, x1, y1, z] = lines.slice(i, i + 5);
      trace(context, [drawing.place(x0, y0, z), drawing.place(x1, y1, z)]);
    }
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.stroke();
  }
}

// The name of each level beside its corner that is drawn farthest to the left.
function nameLevels(context, walk, drawing) {
  context.fillStyle = "#000";
  context.font = "12px sans-serif";
  context.textAlign = "right";
  for (const level of walk.levels) {
    const places = level.floors.rings.flatMap((floor) => ringPixels(floor.rings[0], floor.height_m, drawing));
    if (!places.length) continue;
    const [u, v] = places.reduce((left, place) => (place[0] < left[0] ? place : left));
    context.fillText("level " + level.level, Math.max(u - 8, 52), v);
  }
  context.textAlign = "left";
}

function drawRuns(context, found, colour, width, dash) {
  context.beginPath();
  for (const run of found) trace(context, run);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

function drawDots(context, walk, cloud, k, shown, drawing, size) {
  for (const dead of [true, false]) {
    for (let i = cloud.first[k]; i < cloud.first[k + 1]; i++) {
      const dot = dotAt(walk, cloud, i);
      if (dot.dead !== dead || !shown(dot.level)) continue;
      const [u, v] = drawing.place(dot.x, dot.y, dot.z);
      context.fillStyle = dead ? walk.colours.dead : walk.colours.levels[dot.level % walk.colours.levels.length];
      context.fillRect(u - size / 2, v - size / 2, size, size);
    }
  }
}

function drawReference(context, row, drawing) {
  const [u, v] = drawing.place(row[0], row[1], row[3] === null ? 0 : row[3]);
  context.beginPath();
  trace(context, [[u, v - 26], [u, v - 8]]);
  context.strokeStyle = context.fillStyle = REFERENCE;
  context.lineWidth = 2.5;
  context.stroke();
  context.beginPath();
  trace(context, [[u, v], [u - 5, v - 10], [u + 5, v - 10]]);
  context.fill();
}

function drawEstimate(context, row, sigma, hollow, drawing) {
  const [u, v] = drawing.place(row[0], row[1], row[3] === null ? 0 : row[3]);
  if (sigma !== null && sigma > 0) {
    context.beginPath();
    context.arc(u, v, sigma * drawing.scale, 0, 2 * Math.PI);
    context.fillStyle = "rgba(0, 114, 178, 0.15)";
    context.fill();
  }
  context.beginPath();
  context.arc(u, v, 5, 0, 2 * Math.PI);
  context.fillStyle = hollow ? "#fff" : ESTIMATE;
  context.fill();
  context.strokeStyle = "#000";
  context.lineWidth = 1;
  context.stroke();
}

function drawScale(context, drawing, height) {
  const length = [1, 2, 5, 10, 20, 50].filter((metres) => metres * drawing.scale <= 120).pop() || 1;
  context.fillStyle = "#000";
  context.fillRect(10, height - 12, length * drawing.scale, 3);
  context.font = "12px sans-serif";
  context.fillText(length + " m", 10, height - 16);
}

function start(walk) {
  const cloud = decodeCloud(walk.cloud);
  const count = walk.frames.t_s.length;
  const find = (id) => document.getElementById(id);
  const state = { frame: 0, playing: false, speed: 1, view: "all", nearM: 24, before: null, owed: 0 };

  const views = [["follow", "level of the estimate"], ...walk.levels.map((level) => [String(level.level), "level " + level.level])];
  if (walk.levels.length > 1 && walk.has_map) views.unshift(["all", "all levels"]);
  state.view = views[0][0];
  for (const [value, text] of views) find("view").add(new Option(text, value));
  for (const speed of SPEEDS) find("speed").add(new Option(describeSpeed(walk, speed), speed, speed === 1, speed === 1));
  find("scrubber").max = count - 1;
  fillLegend(walk);

  function chosenLevels(estimate) {
    if (state.view === "all") return walk.levels;
    const level = state.view === "follow" ? (estimate ? estimate[2] : walk.levels[0].level) : Number(state.view);
    return walk.levels.filter((one) => one.level === level);
  }

  function drawPanel(box, drawing, levels, isNear) {
    const context = box.context;
    const names = levels.map((level) => level.level);
    const has = (row) => names.includes(row[2]);
    const k = state.frame;
    context.setTransform(box.ratio, 0, 0, box.ratio, 0, 0);
    context.clearRect(0, 0, box.width, box.height);
    context.lineJoin = context.lineCap = "round";
    drawBuilding(context, walk, levels, drawing);
    if (!isNear && state.view === "all") nameLevels(context, walk, drawing);
    if (find("path").checked) drawRuns(context, runs(walk.reference, has, drawing), REFERENCE, 1.2, [5, 3]);
    if (find("dots").checked) {
      const shown = (index) => names.includes(walk.levels[index].level);
      drawDots(context, walk, cloud, k, shown, drawing, isNear ? 3 : 2);
    }
    drawRuns(context, runs(trail(walk, k), has, drawing), ESTIMATE, 1.8, []);
    const reference = walk.frames.reference[k];
    if (find("path").checked && reference && has(reference)) drawReference(context, reference, drawing);
    const estimate = lastEstimate(walk, k);
    const sigma = isNear && walk.frames.converged[k] !== false ? walk.frames.sigma_m[k] : null;
    if (estimate) drawEstimate(context, estimate, sigma, !has(estimate), drawing);
    if (isNear || state.view !== "all") drawScale(context, drawing, box.height);
  }

  function draw() {
    const k = state.frame;
    const estimate = lastEstimate(walk, k);
    const whole = sized(find("whole"));
    const flat = [[1, 0, 0], [0, 1, 0]];
    const matrix = state.view === "all" ? walk.matrix : flat;
    drawPanel(whole, fit(matrix, corners(walk), whole.width, whole.height), chosenLevels(estimate), false);
    const near = sized(find("near"));
    const middle = estimate || walk.frames.reference[k] || [0, 0, walk.levels[0].level];
    const level = walk.levels.filter((one) => one.level === middle[2]);
    drawPanel(near, around(middle[0], middle[1], state.nearM, near.width, near.height), level, true);
    find("scrubber").value = k;
    find("play").textContent = state.playing ? "Pause" : "Play";
    find("words").replaceChildren(...words(walk, k).map(([name, text]) => tableRow(name, text)));
  }

  function go(frame) {
    state.frame = Math.max(0, Math.min(count - 1, frame));
    draw();
  }

  function tick(now) {
    if (!state.playing) return;
    if (state.before !== null) state.owed += ((now - state.before) / 1000) * walk.fps * state.speed;
    state.before = now;
    const due = Math.floor(state.owed);
    state.owed -= due;
    if (state.frame + due >= count - 1) state.playing = false;
    if (due) go(state.frame + due);
    requestAnimationFrame(tick);
  }

  function play(wanted) {
    state.playing = wanted;
    state.before = null;
    state.owed = 0;
    if (wanted && state.frame === count - 1) state.frame = 0;
    draw();
    if (wanted) requestAnimationFrame(tick);
  }

  function choose(id, by) {
    const select = find(id);
    select.selectedIndex = (select.selectedIndex + by + select.length) % select.length;
    select.dispatchEvent(new Event("change"));
  }

  find("play").addEventListener("click", () => play(!state.playing));
  find("scrubber").addEventListener("input", (event) => go(Number(event.target.value)));
  find("speed").addEventListener("change", (event) => { state.speed = Number(event.target.value); });
  find("view").addEventListener("change", (event) => { state.view = event.target.value; draw(); });
  for (const id of ["dots", "path"]) find(id).addEventListener("change", draw);
  find("near").addEventListener("wheel", (event) => {
    event.preventDefault();
    state.nearM = Math.max(4, Math.min(120, state.nearM * Math.exp(event.deltaY / 500)));
    draw();
  }, { passive: false });
  const keys = {
    " ": () => play(!state.playing),
    ArrowLeft: (event) => go(state.frame - (event.shiftKey ? 10 : 1)),
    ArrowRight: (event) => go(state.frame + (event.shiftKey ? 10 : 1)),
    Home: () => go(0),
    End: () => go(count - 1),
    "+": () => find("speed").selectedIndex < SPEEDS.length - 1 && choose("speed", 1),
    "-": () => find("speed").selectedIndex > 0 && choose("speed", -1),
    v: () => choose("view", 1),
  };
  document.addEventListener("keydown", (event) => {
    if (!(event.key in keys) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (document.activeElement !== document.body) document.activeElement.blur();
    event.preventDefault();
    keys[event.key](event);
  });
  window.addEventListener("resize", draw);
  draw();
}

function describeSpeed(walk, speed) {
  const real = walk.fps * walk.frame_s * speed;
  return "× " + Number(real.toPrecision(2)) + " real time";
}

function fillLegend(walk) {
  const entries = [["estimate: disc and line", ESTIMATE], ["reference: arrow and dashed line", REFERENCE]];
  if (walk.cloud.first[walk.cloud.first.length - 1]) {
    const colours = walk.colours.levels;
    walk.levels.forEach((level, i) => entries.push(["particles, level " + level.level, colours[i % colours.length]]));
    entries.push(["particles that hit a wall", walk.colours.dead]);
  }
  for (const [text, colour] of entries) {
    const entry = document.createElement("span");
    const swatch = document.createElement("i");
    swatch.style.background = colour;
    entry.append(swatch, text);
    document.getElementById("legend").append(entry, " ");
  }
}

function tableRow(name, text) {
  const row = document.createElement("tr");
  for (const content of [name, text]) {
    const cell = document.createElement("td");
    cell.textContent = content;
    row.append(cell);
  }
  return row;
}

// The canvas of a box, as many pixels as the screen has.
function sized(box) {
  const canvas = box.querySelector("canvas");
  const ratio = window.devicePixelRatio || 1;
  const width = Math.max(1, box.clientWidth);
  const height = Math.max(1, box.clientHeight);
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
  }
  return { context: canvas.getContext("2d"), ratio, width, height };
}

if (typeof document === "undefined") module.exports = player;
else if (document.getElementById("walk")) start(JSON.parse(document.getElementById("walk").textContent));
