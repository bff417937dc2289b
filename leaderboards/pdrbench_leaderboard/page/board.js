"use strict";
// Sorting, filters and the choice of two entries. The table is in the page: without this it can still be read.
(() => {
  const table = document.getElementById("board");
  const body = table.tBodies[0];
  const rows = [...body.rows];
  const form = document.getElementById("filters");
  const count = document.getElementById("count");
  const compare = document.getElementById("compare");
  const all = document.getElementById("all");
  const FIRST_ROWS = 200;

  // A cell's value by column: text, or a number; null where there is none.
  function valueOf(row, column, kind) {
    const cell = row.cells[column];
    const text = cell.dataset.value ?? cell.textContent;
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

  // Rows in the order of the sorting, and whether all that match are shown or only the first: a table of a thousand
  // rows takes a second to lay out.
  let order = rows;
  let limit = FIRST_ROWS;

  function sortBy(head, direction) {
    const sign = direction === "ascending" ? 1 : -1;
    const keys = new Map(rows.map((row, i) => [row, [valueOf(row, head.cellIndex, head.dataset.sort), i]]));
    order = [...rows].sort((one, other) => before(keys.get(one)[0], keys.get(other)[0], sign) || keys.get(one)[1] - keys.get(other)[1]);
    for (const other of table.tHead.rows[0].cells) if (other.dataset.sort) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", direction);
    body.append(...order);
    show();
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

  function show() {
    const words = form.querySelector("#text").value.toLowerCase().split(/\s+/).filter(Boolean);
    const forbidden = [...form.querySelectorAll("input[name=sensor]:not(:checked)")].map((box) => box.value);
    const wanted = ["map", "survey", "tier", "division"].map((name) => [name, form.querySelector(`#${name}`).value]);
    let found = 0;
    for (const row of order) {
      const sensors = row.dataset.sensors.split(" ");
      const isWanted =
        words.every((word) => row.dataset.search.includes(word)) &&
        !forbidden.some((sensor) => sensors.includes(sensor)) &&
        wanted.every(([name, value]) => !value || row.dataset[name] === value);
      if (isWanted) found++;
      row.hidden = !isWanted || found > limit;
      row.classList.remove("later");
    }
    const part = found > limit ? `, the first ${limit} are shown` : "";
    count.textContent = (found === rows.length ? `${found} entries` : `${found} of ${rows.length} entries`) + part;
    all.hidden = found <= limit;
  }

  all.addEventListener("click", () => {
    limit = Infinity;
    show();
  });
  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.addEventListener("reset", () => setTimeout(show)); // the fields change after the event
  form.hidden = false;
  form.reset(); // browsers restore what was chosen
  show();

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
