"use strict";
// Pictures of one entry; walks are fetched when they scroll into view.
(() => {
  const facts = pdrbench.pageFacts();
  const { digits, table } = draw;

  function failed(node, error) {
    node.replaceChildren(draw.html("p", { class: "error" }, `Cannot be shown: ${error.message}.`));
  }

  const cdf = document.getElementById("cdf");
  const walks = document.getElementById("walks");
  pdrbench
    .fetchData(facts.env, `entries/${facts.slug}`)
    .then((data) => {
      charts.cdfChart(cdf, [{ name: facts.name, side: "a", cdf: data.cdf }]);
      const shown = data.walks.map((walk) => ({ ...walk, value: walk.values[facts.metric] }));
      charts.walksChart(walks, shown, `${facts.metric}${facts.unit ? `, ${facts.unit}` : ""}`);
      const names = data.walks.length ? Object.keys(data.walks[0].values) : [];
      const lines = data.walks.map((walk) => [walk.walk, walk.building || "–", walk.status.join(", "), ...names.map((name) => digits(walk.values[name]))]);
      table(["walk", "building", "status", ...names], lines, document.getElementById("walks-table"));
    })
    .catch((error) => failed(cdf, error));

  const node = document.getElementById("replay");
  const watcher = new IntersectionObserver(
    (seen) => {
      if (!seen.some((one) => one.isIntersecting)) return;
      watcher.disconnect();
      const tracksOf = (slug) => pdrbench.fetchData(facts.env, `entries/${slug}.tracks`);
      Promise.all([pdrbench.fetchData(facts.env, "plans"), pdrbench.fetchData(facts.env, "entries"), tracksOf(facts.slug)])
        .then(([plans, entries, tracks]) => {
          const isWanted = Boolean(replay.asked(location.hash).walk); // the address names a moment
          replay.player(node, plans, tracks, facts.name, entries.filter((one) => one.slug !== facts.slug), tracksOf);
          if (isWanted) node.scrollIntoView();
        })
        .catch((error) => failed(node, error));
    },
    { rootMargin: "400px" },
  );
  watcher.observe(node);
  if (replay.asked(location.hash).walk) node.scrollIntoView();
})();
