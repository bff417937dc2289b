"use strict";
// Distribution of errors, scores of walks, one entry against another.
const charts = (() => {
  const { svg, html, ticks, logTicks, log, digits, frame, path, responsive } = draw;

  const percent = (share) => `${Math.round(100 * share)} %`;

  // The share of errors of at most `at`: a step function.
  function shareAt(cdf, at) {
    let share = 0;
    for (let i = 0; i < cdf.error_m.length && cdf.error_m[i] <= at; i++) share = cdf.share[i];
    return share;
  }

  // `series`: {name, side: "a" or "b", cdf}.
  function cdfChart(figure, series) {
    const shown = series.filter((one) => one.cdf.error_m.length);
    if (!shown.length) {
      figure.replaceChildren(html("p", {}, "There are no errors to show: nothing was scored."));
      return;
    }
    const most = Math.max(...shown.map((one) => one.cdf.error_m.at(-1)));
    responsive(figure, (width) => {
      const x = { low: 0, high: most, ticks: ticks(0, most, width / 90), label: "position error in m" };
      const y = { low: 0, high: 1, ticks: [0, 0.25, 0.5, 0.75, 1], label: "share of surveyed positions", text: percent };
      const summaries = shown.map((one) => `${one.name}: median ${digits(one.cdf.p50_m)} m, 95 % ${digits(one.cdf.p95_m)} m`);
      const { picture, place, box } = frame(width, 300, x, y, `Distribution of errors. ${summaries.join("; ")}`);
      for (const one of shown) {
        const { error_m, share, low, high } = one.cdf;
        if (low.length) {
          const edge = (values) => error_m.map((error, i) => [place.x(error), place.y(values[i])]);
          picture.append(path([...edge(low), ...edge(high).reverse()], { class: `band ${one.side}` }));
        }
        const steps = error_m.flatMap((error, i) => [
          [place.x(error), place.y(i ? share[i - 1] : 0)],
          [place.x(error), place.y(share[i])],
        ]);
        picture.append(path(steps, { class: `line ${one.side}` }));
      }
      const cursor = svg("line", { class: "cursor", y1: box.top, y2: box.bottom, visibility: "hidden" });
      picture.append(cursor);
      const readout = html("figcaption", {});
      const rest = () => {
        cursor.setAttribute("visibility", "hidden");
        readout.replaceChildren(
          ...shown.map((one, i) => html("span", { class: "key" }, html("span", { class: `swatch ${one.side}` }), summaries[i])),
          shown.some((one) => one.cdf.low.length) ? "Band: 95 % interval by the spread of units." : "No band: too few units.",
        );
      };
      picture.addEventListener("pointermove", (event) => {
        const u = ((event.clientX - picture.getBoundingClientRect().left) * width) / picture.clientWidth;
        const at = ((u - box.left) / (box.right - box.left)) * most;
        if (at < 0 || at > most) return rest();
        cursor.setAttribute("x1", u);
        cursor.setAttribute("x2", u);
        cursor.setAttribute("visibility", "visible");
        const parts = shown.map((one) => `${percent(shareAt(one.cdf, at))} ${one.name}`);
        readout.textContent = `at most ${digits(at)} m: ${parts.join(", ")}`;
      });
      picture.addEventListener("pointerleave", rest);
      rest();
      return [picture, readout];
    });
  }

  // One bar for each walk, in the order of the board. `walks`: {walk, building, value}.
  function walksChart(figure, walks, label) {
    const values = walks.map((walk) => walk.value).filter((value) => value !== null);
    if (!values.length) {
      figure.replaceChildren(html("p", {}, "No walk was scored."));
      return;
    }
    const most = Math.max(...values, 1e-9);
    responsive(figure, (width) => {
      const places = ticks(1, walks.length, Math.min(walks.length - 1, width / 60) || 1).filter(Number.isInteger);
      const x = { low: 0.5, high: walks.length + 0.5, ticks: places, label: "walk" };
      const { picture, place, box } = frame(width, 220, x, { low: 0, high: most, ticks: ticks(0, most, 4), label }, `${label} of each walk`);
      const thick = Math.min(26, (0.7 * (box.right - box.left)) / walks.length);
      walks.forEach((walk, i) => {
        if (walk.value === null) return;
        const top = place.y(walk.value);
        const bar = { x: place.x(i + 1) - thick / 2, y: top, width: thick, height: Math.max(1, box.bottom - top), class: "dot a" };
        picture.append(svg("rect", bar, svg("title", {}, `walk ${i + 1}, ${walk.walk}${walk.building ? ` in ${walk.building}` : ""}: ${digits(walk.value)}`)));
      });
      return [picture];
    });
  }

  // Each walk as a dot: one entry to the right, the other upwards. `walks`: {walk, a, b}, both numbers.
  function scatterChart(figure, walks, names, unit) {
    if (!walks.length) {
      figure.replaceChildren(html("p", {}, "No walk was scored for both."));
      return;
    }
    const all = walks.flatMap((walk) => [walk.a, walk.b]).filter((value) => value > 0);
    const low = all.length ? Math.min(...all) / 1.15 : 0.1;
    const high = all.length ? Math.max(...all) * 1.15 : 1;
    responsive(figure, (width) => {
      const side = { low, high, ticks: logTicks(low, high), scale: log };
      const title = `${walks.length} walks; below the diagonal, ${names[1]} has the smaller value`;
      const { picture, place } = frame(width, 320, { ...side, label: `${names[0]}, ${unit}` }, { ...side, label: `${names[1]}, ${unit}` }, title);
      picture.append(path([[place.x(low), place.y(low)], [place.x(high), place.y(high)]], { class: "diagonal" }));
      walks.forEach((walk) => {
        const text = svg("title", {}, `${walk.walk}: ${digits(walk.a)} and ${digits(walk.b)}`);
        const where = { cx: place.x(walk.a), cy: place.y(walk.b), r: 4.5 };
        picture.append(svg("circle", { ...where, class: `dot ${walk.a <= walk.b ? "a" : "b"}` }, text));
      });
      return [picture, html("figcaption", {}, "Both axes logarithmic; on the diagonal both are equal.")];
    });
  }

  // First minus second of each walk, from the smallest to the largest.
  function differenceChart(figure, walks, names, unit, lowerIsBetter) {
    if (!walks.length) {
      figure.replaceChildren(html("p", {}, "No walk was scored for both."));
      return;
    }
    const sorted = walks.map((walk) => ({ ...walk, by: walk.a - walk.b })).sort((one, other) => one.by - other.by);
    const low = Math.min(0, ...sorted.map((walk) => walk.by));
    const high = Math.max(0, ...sorted.map((walk) => walk.by));
    const span = high > low ? [low, high] : [-1, 1];
    responsive(figure, (width) => {
      const x = { low: 0.5, high: sorted.length + 0.5, ticks: [], label: "walks, sorted" };
      const y = { low: span[0], high: span[1], ticks: ticks(span[0], span[1], 5), label: `difference, ${unit}` };
      const { picture, place, box } = frame(width, 320, x, y, `${names[0]} minus ${names[1]} by walk`);
      const thick = Math.min(26, (0.7 * (box.right - box.left)) / sorted.length);
      sorted.forEach((walk, i) => {
        const ends = [place.y(0), place.y(walk.by)];
        const firstWins = lowerIsBetter ? walk.by < 0 : walk.by > 0;
        const bar = { x: place.x(i + 1) - thick / 2, y: Math.min(...ends), width: thick, height: Math.max(1, Math.abs(ends[0] - ends[1])) };
        picture.append(svg("rect", { ...bar, class: `dot ${firstWins ? "a" : "b"}` }, svg("title", {}, `${walk.walk}: ${digits(walk.by)}`)));
      });
      picture.append(path([[box.left, place.y(0)], [box.right, place.y(0)]], { class: "zero" }));
      return [picture, html("figcaption", {}, `${names[0]} minus ${names[1]}; the colour is that of the better one.`)];
    });
  }

  return { cdfChart, walksChart, scatterChart, differenceChart, shareAt };
})();
