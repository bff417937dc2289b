"use strict";
// Sorting, filters and the choice of two entries. The table is in the page: without this it can still be read.
(() => {
  const table = document.getElementById("board");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const form = document.getElementById("filters");
  const count = document.getElementById("count");
  const compare = document.getElementById("compare");

  // A cell's value by column: text, or a number; null where there is none.
  function valueOf(row, column, kind) {
    const text = row.cells[column].dataset.value || "";
    if (kind === "text") return text.toLowerCase();
    const number = Number(text);
    return text !== "" && Number.isFinite(number) ? number : null;
  }

  // What has no value comes last, whatever the direction.
  function before(one, other, sign) {
    if (one === other) return 0;
    if (one === null) return 1;
    if (other === null) return -1;
    return one < other ? -sign : sign;
  }

  function sortBy(head, direction) {
    const sign = direction === "ascending" ? 1 : -1;
    const keys = new Map(rows.map((row, i) => [row, [valueOf(row, head.cellIndex, head.dataset.sort), i]]));
    const order = [...rows].sort((one, other) => before(keys.get(one)[0], keys.get(other)[0], sign) || keys.get(one)[1] - keys.get(other)[1]);
    for (const other of table.tHead.rows[0].cells) if (other.dataset.sort) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", direction);
    body.append(...order);
  }

  for (const head of table.tHead.rows[0].cells) {
    if (!head.dataset.sort) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      const first = head.dataset.first || "ascending";
      const turned = { ascending: "descending", descending: "ascending" };
      const now = head.getAttribute("aria-sort");
      sortBy(head, now ? turned[now] : first);
    });
  }

  function filter() {
    const words = form.querySelector("#text").value.toLowerCase().split(/\s+/).filter(Boolean);
    const forbidden = [...form.querySelectorAll("input[name=sensor]:not(:checked)")].map((box) => box.value);
    const wanted = ["map", "survey", "tier", "division"].map((name) => [name, form.querySelector(`#${name}`).value]);
    let shown = 0;
    for (const row of rows) {
      const sensors = row.dataset.sensors.split(" ");
      row.hidden =
        words.some((word) => !row.dataset.search.includes(word)) ||
        forbidden.some((sensor) => sensors.includes(sensor)) ||
        wanted.some(([name, value]) => value && row.dataset[name] !== value);
      if (!row.hidden) shown++;
    }
    count.textContent = shown === rows.length ? `${shown} entries` : `${shown} of ${rows.length} entries`;
  }

  form.addEventListener("input", filter);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(filter)); // the fields change after the event
  form.hidden = false;

  // At most two are chosen: a third takes the place of the one chosen first.
  let chosen = [];
  for (const box of body.querySelectorAll(".pick")) {
    box.hidden = false;
    box.checked = false; // browsers restore what was ticked
    box.addEventListener("change", () => {
      chosen = chosen.filter((other) => other !== box);
      if (box.checked) chosen.push(box);
      if (chosen.length > 2) chosen.shift().checked = false;
      const [a, b] = chosen.map((one) => encodeURIComponent(one.value));
      compare.href = `compare.html${a ? `?a=${a}` : ""}${b ? `&b=${b}` : ""}`;
      compare.textContent = ["Compare two entries", "Compare with one more", "Compare these two"][chosen.length];
    });
  }
})();
