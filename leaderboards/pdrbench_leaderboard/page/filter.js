"use strict";
// The index shows the first entries of each board that need nothing which is not given.
(() => {
  const form = document.getElementById("given");

  function show() {
    const given = new Set([...form.querySelectorAll("[name=sensor]:checked")].map((box) => box.value));
    const has = (name) => form.elements[name].checked;
    for (const board of document.querySelectorAll(".board")) {
      board.hidden = board.dataset.start === "yes" && !has("start");
      let left = Number(board.dataset.first);
      for (const row of board.querySelectorAll("tbody tr")) {
        const needs = row.dataset.sensors.split(" ").filter(Boolean);
        const suits =
          needs.every((sensor) => given.has(sensor)) &&
          (row.dataset.map === "no" || has("map")) &&
          (row.dataset.survey === "no" || has("survey"));
        row.hidden = !suits || left <= 0;
        if (!row.hidden) left--;
      }
    }
  }

  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.hidden = false;
  form.reset(); // browsers restore what was ticked
  show();
})();
