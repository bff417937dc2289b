"use strict";
// Search over environments and localizers. Everything is in the page: without this it can still be read.
(() => {
  const form = document.getElementById("find");
  const field = document.getElementById("text");
  const count = document.getElementById("count");
  const searched = [...document.querySelectorAll("[data-search]")];

  function show() {
    const words = field.value.toLowerCase().split(/\s+/).filter(Boolean);
    const found = { TR: 0, LI: 0 };
    for (const item of searched) {
      item.hidden = !words.every((word) => item.dataset.search.includes(word));
      if (!item.hidden) found[item.tagName]++;
    }
    const plural = (number, what) => `${number} ${what}${number === 1 ? "" : "s"}`;
    count.textContent = `${plural(found.TR, "environment")}, ${plural(found.LI, "localizer")}`;
  }

  form.addEventListener("input", show);
  form.addEventListener("submit", (event) => event.preventDefault());
  form.hidden = false;
  form.reset(); // browsers restore what was typed
  show();
})();
