"use strict";
// Elements, scales and axes. Text is always set as text: nothing that a stranger wrote becomes markup.
const draw = (() => {
  const SVG = "http://www.w3.org/2000/svg";

  function fill(node, attributes, children) {
    for (const [name, value] of Object.entries(attributes)) {
      if (value !== null && value !== undefined && value !== false) node.setAttribute(name, value === true ? "" : value);
    }
    node.append(...children.filter((child) => child !== null).map((child) => (child instanceof Node ? child : String(child))));
    return node;
  }

  const svg = (name, attributes = {}, ...children) => fill(document.createElementNS(SVG, name), attributes, children);
  const html = (name, attributes = {}, ...children) => fill(document.createElement(name), attributes, children);

  // Round places between two numbers, about so many.
  function ticks(low, high, count = 5) {
    if (!(high > low)) return [low];
    const rough = (high - low) / count;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 5, 10].map((factor) => factor * power).find((size) => size >= rough);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(Number((k * step).toPrecision(12)));
    return found;
  }

  // Places for a logarithmic axis: 1, 2 and 5 of every decade, or whole decades where there are many.
  function logTicks(low, high) {
    const decades = Math.log10(high / low);
    const factors = decades > 3 ? [1] : [1, 2, 5];
    const found = [];
    for (let power = Math.floor(Math.log10(low)); power <= Math.ceil(Math.log10(high)); power++)
      for (const factor of factors) {
        const value = Number((factor * 10 ** power).toPrecision(12));
        if (value >= low * (1 - 1e-9) && value <= high * (1 + 1e-9)) found.push(value);
      }
    return found;
  }

  const linear = (low, high, from, to) => (value) => from + ((value - low) / (high - low || 1)) * (to - from);
  const log = (low, high, from, to) => (value) =>
    from + (Math.log(Math.max(value, low) / low) / (Math.log(high / low) || 1)) * (to - from);

  // Two decimals, or two digits where that would show nothing; as the tables print.
  function digits(value) {
    if (value === null || value === undefined) return "–";
    const size = Math.abs(value);
    const text = size >= 1000 ? value.toFixed(0) : size > 0 && size < 0.1 ? String(Number(value.toPrecision(2))) : value.toFixed(2);
    return text.replace("-", "−");
  }

  const short = (value) => String(Number(value.toPrecision(6))).replace("-", "−");

  // A drawing area with axes. `x` and `y` are {low, high, ticks, label, scale: linear or log, text}.
  function frame(width, height, x, y, title) {
    const left = 62;
    const right = 12;
    const top = 10;
    const bottom = 40;
    const place = {
      x: (x.scale || linear)(x.low, x.high, left, width - right),
      y: (y.scale || linear)(y.low, y.high, height - bottom, top),
    };
    const picture = svg("svg", { viewBox: `0 0 ${width} ${height}`, width, height, role: "img", "aria-label": title });
    const grid = svg("g", { class: "grid" });
    const words = svg("g", { class: "axis" });
    for (const value of x.ticks) {
      const at = place.x(value);
      grid.append(svg("line", { x1: at, x2: at, y1: top, y2: height - bottom }));
      words.append(svg("text", { x: at, y: height - bottom + 16, "text-anchor": "middle" }, (x.text || short)(value)));
    }
    for (const value of y.ticks) {
      const at = place.y(value);
      grid.append(svg("line", { x1: left, x2: width - right, y1: at, y2: at }));
      words.append(svg("text", { x: left - 6, y: at + 4, "text-anchor": "end" }, (y.text || short)(value)));
    }
    words.append(svg("text", { x: (left + width - right) / 2, y: height - 6, "text-anchor": "middle" }, x.label));
    const middle = (top + height - bottom) / 2;
    words.append(svg("text", { transform: `translate(13 ${middle}) rotate(-90)`, "text-anchor": "middle" }, y.label));
    picture.append(grid, words);
    return { picture, place, box: { left, right: width - right, top, bottom: height - bottom } };
  }

  const path = (points, attributes) =>
    svg("path", { d: points.map(([u, v], i) => `${i ? "L" : "M"}${u.toFixed(1)} ${v.toFixed(1)}`).join(""), ...attributes });

  // Draws anew whenever the figure's width changes.
  function responsive(figure, paint) {
    let width = 0;
    const repaint = () => {
      const now = Math.max(260, Math.floor(figure.clientWidth));
      if (now === width) return;
      width = now;
      figure.replaceChildren(...paint(width));
    };
    if (figure.watcher) figure.watcher.disconnect();
    figure.watcher = new ResizeObserver(repaint);
    figure.watcher.observe(figure);
    repaint();
  }

  function table(head, rows, into) {
    const cells = (line, kind) => line.map((text, i) => html(kind === "th" || i === 0 ? "th" : "td", { class: i ? "number" : null, scope: kind === "th" ? "col" : i === 0 ? "row" : null }, text));
    into.replaceChildren(
      html("thead", {}, html("tr", {}, ...cells(head, "th"))),
      html("tbody", {}, ...rows.map((row) => html("tr", {}, ...cells(row, "td")))),
    );
  }

  return { svg, html, ticks, logTicks, linear, log, digits, short, frame, path, responsive, table };
})();
