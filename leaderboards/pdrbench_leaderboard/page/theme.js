"use strict";
// Light or dark: as the system says, until the switch says otherwise. In the head, so that nothing flashes.
(() => {
  const root = document.documentElement;
  root.classList.add("js");
  const kept = () => {
    try {
      return localStorage.getItem("pdrbench-theme");
    } catch {
      return null; // storage may be forbidden for files
    }
  };
  const system = matchMedia("(prefers-color-scheme: dark)");
  const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : system.matches);
  const saved = kept();
  if (saved === "dark" || saved === "light") root.dataset.theme = saved;
  document.addEventListener("DOMContentLoaded", () => {
    const button = document.getElementById("theme");
    const name = () => {
      button.textContent = isDark() ? "Light" : "Dark";
      button.setAttribute("aria-label", `Switch to the ${isDark() ? "light" : "dark"} theme`);
    };
    button.hidden = false;
    button.addEventListener("click", () => {
      root.dataset.theme = isDark() ? "light" : "dark";
      try {
        localStorage.setItem("pdrbench-theme", root.dataset.theme);
      } catch {
        // kept for this page only
      }
      name();
    });
    system.addEventListener("change", name);
    name();
  });
})();
