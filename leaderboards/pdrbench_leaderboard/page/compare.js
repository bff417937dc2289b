"use strict";
// Two entries side by side: the paired test as the evaluator made it, and the walks it was made of.
(() => {
  const facts = pdrbench.pageFacts();
  const { digits, html, table } = draw;
  const selects = { a: document.getElementById("a"), b: document.getElementById("b") };
  const verdict = document.getElementById("verdict");
  const tiles = document.getElementById("tiles");
  const nameOf = (select) => select.selectedOptions[0].dataset.name;

  // The comparison of two names, turned so that `first` comes first; null where they were not tested.
  function findPair(pairs, first, second) {
    const [i, j] = [pairs.names.indexOf(first), pairs.names.indexOf(second)];
    for (const row of pairs.rows) {
      const isTurned = row[0] === j && row[1] === i;
      if (!isTurned && (row[0] !== i || row[1] !== j)) continue;
      const [walks, effect, low, high, p, holm, wins, winsLow, winsHigh] = row.slice(2);
      const minus = (value) => (value === null ? null : -value);
      const rest = (value) => (value === null ? null : 1 - value);
      const pair = { walks, p, holm };
      return isTurned
        ? { ...pair, effect: minus(effect), low: minus(high), high: minus(low), wins: rest(wins), winsLow: rest(winsHigh), winsHigh: rest(winsLow) }
        : { ...pair, effect, low, high, wins, winsLow, winsHigh };
    }
    return null;
  }

  const between = (low, high, text) => (low === null || high === null ? "" : `; 95 % interval ${text(low)} to ${text(high)}`);
  const percent = (share) => `${Math.round(100 * share)} %`;

  function tell(pair, first, second) {
    if (first === second) {
      verdict.textContent = "Choose two different entries.";
      tiles.replaceChildren();
      return;
    }
    if (!pair) {
      verdict.textContent = "These two were not tested: one of them is not ranked, or too far down.";
      tiles.replaceChildren();
      return;
    }
    const isBetter = facts.better === "higher" ? pair.effect > 0 : pair.effect < 0;
    const ahead = isBetter ? first : second;
    verdict.textContent =
      pair.holm < facts.significant
        ? `${ahead} is better, and significantly so.`
        : `No significant difference: ${pair.effect === 0 ? "the means are equal" : `${ahead} has the better mean, which may be chance`}.`;
    const cells = [
      ["difference", `${digits(pair.effect)} ${facts.unit}`, `first minus second, mean over walks${between(pair.low, pair.high, digits)}`],
      ["p, adjusted", digits(pair.holm), "Holm, for all pairs of the board"],
      ["p", String(Number(pair.p.toPrecision(2))), "sign-flip test of whole units"],
      ["first is better on", percent(pair.wins), `of ${pair.walks} walks: probability of improvement${between(pair.winsLow, pair.winsHigh, percent)}`],
    ];
    tiles.replaceChildren(...cells.map(([what, value, how]) => html("div", { class: "tile" }, html("dt", {}, what), html("dd", {}, html("b", {}, value), html("span", { class: "under" }, how)))));
  }

  function showWalks(first, second, names) {
    const others = new Map(second.walks.map((walk) => [walk.walk, walk.values[facts.metric]]));
    const walks = first.walks.map((walk) => ({ walk: walk.walk, a: walk.values[facts.metric], b: others.get(walk.walk) ?? null }));
    const both = walks.filter((walk) => walk.a !== null && walk.b !== null);
    charts.scatterChart(document.getElementById("scatter"), both, names, facts.unit);
    charts.differenceChart(document.getElementById("difference"), both, names, facts.unit, facts.better !== "higher");
    const lines = walks.map((walk) => [walk.walk, digits(walk.a), digits(walk.b), walk.a === null || walk.b === null ? "–" : digits(walk.a - walk.b)]);
    table(["walk", names[0], names[1], "difference"], lines, document.getElementById("walks-table"));
    const series = [first, second].map((data, i) => ({ name: names[i], side: "ab"[i], cdf: data.cdf }));
    charts.cdfChart(document.getElementById("cdf"), series);
  }

  let asked = 0;
  async function show() {
    const mine = ++asked;
    const names = [nameOf(selects.a), nameOf(selects.b)];
    try {
      const [pairs, first, second] = await Promise.all([
        pdrbench.fetchData(facts.env, "pairs"),
        ...["a", "b"].map((side) => pdrbench.fetchData(facts.env, `entries/${selects[side].value}`)),
      ]);
      if (mine !== asked) return; // another choice was made meanwhile
      tell(findPair(pairs, ...names), ...names);
      showWalks(first, second, names);
    } catch (error) {
      verdict.textContent = `Cannot be shown: ${error.message}.`;
    }
  }

  // Into the address, so that it can be passed on.
  function remember() {
    const query = new URLSearchParams({ a: selects.a.value, b: selects.b.value });
    try {
      history.replaceState(null, "", `?${query}`);
    } catch {
      // some browsers forbid it for files
    }
    show();
  }

  const asks = new URLSearchParams(location.search);
  const has = (select, value) => [...select.options].some((option) => option.value === value);
  if (selects.a.options.length > 1) selects.b.selectedIndex = 1;
  for (const side of ["a", "b"]) if (has(selects[side], asks.get(side))) selects[side].value = asks.get(side);
  if (selects.a.value === selects.b.value && selects.a.options.length > 1 && !asks.get("b")) selects.b.selectedIndex = selects.a.selectedIndex ? 0 : 1;
  for (const select of Object.values(selects)) select.addEventListener("change", remember);
  document.getElementById("swap").addEventListener("click", () => {
    [selects.a.value, selects.b.value] = [selects.b.value, selects.a.value];
    remember();
  });
  show();
})();
