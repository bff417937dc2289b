"use strict";
// Floor plans, one picture for each level, north up, metres on both axes.
const plan = (() => {
  const { svg, html } = draw;
  const MARGIN_M = 2;

  // Smallest box that holds a building, or the tracks where there is none: x0, y0, x1, y1.
  function bounds(building, tracks) {
    if (building) return building.bounds_m;
    const x = tracks.flatMap((track) => track.x_m);
    const y = tracks.flatMap((track) => track.y_m);
    if (!x.length) return [0, 0, 1, 1];
    return [Math.min(...x), Math.min(...y), Math.max(...x), Math.max(...y)];
  }

  // Flat x, y as a path; y upwards.
  function outline(flat) {
    let text = "";
    for (let i = 0; i < flat.length; i += 2) text += `${i ? "L" : "M"}${flat[i]} ${-flat[i + 1]}`;
    return `${text}Z`;
  }

  function walls(flat) {
    let text = "";
    for (let i = 0; i < flat.length; i += 4) text += `M${flat[i]} ${-flat[i + 1]}L${flat[i + 2]} ${-flat[i + 3]}`;
    return text;
  }

  // The largest round length that is at most a quarter of a width.
  function scaleLength(width) {
    const power = 10 ** Math.floor(Math.log10(width / 4));
    return [5, 2, 1].map((factor) => factor * power).find((length) => length <= width / 4 + 1e-9);
  }

  // A panel for a level: {level, figure, layer}; what moves goes into the layer.
  function panel(level, box, drawn) {
    const [x0, y0, x1, y1] = box;
    const [width, height] = [x1 - x0 + 2 * MARGIN_M, y1 - y0 + 2 * MARGIN_M];
    const view = `${x0 - MARGIN_M} ${-y1 - MARGIN_M} ${width} ${height}`;
    const picture = svg("svg", { viewBox: view, class: "plan", role: "img", "aria-label": `Floor plan of level ${level}` });
    if (drawn) {
      picture.append(svg("path", { d: drawn.floor.map(outline).join(""), class: "floor", "fill-rule": "evenodd" }));
      picture.append(svg("path", { d: drawn.stairs.map(outline).join(""), class: "stairs" }));
      picture.append(svg("path", { d: walls(drawn.walls), class: "wall" }));
    }
    const length = scaleLength(width);
    const [left, bottom] = [x0 - MARGIN_M * 0.6, -y0 + MARGIN_M * 0.6];
    picture.append(svg("path", { d: `M${left} ${bottom}h${length}`, class: "scale" }, svg("title", {}, `${length} m`)));
    const layer = svg("g");
    picture.append(layer);
    const caption = html("figcaption", {}, `level ${level}, bar ${draw.short(length)} m`);
    return { level, figure: html("figure", { class: "level" }, picture, caption), layer, unit: Math.max(width, height) / 100 };
  }

  // A panel for every level of a building; without one, for every level that the tracks name.
  function panels(building, tracks) {
    const box = bounds(building, tracks);
    if (building) return building.levels.map((drawn) => panel(drawn.level, box, drawn));
    const levels = [...new Set(tracks.flatMap((track) => track.level))].sort((one, other) => one - other);
    return (levels.length ? levels : [0]).map((level) => panel(level, box, null));
  }

  return { panels, bounds, outline, walls, scaleLength };
})();
