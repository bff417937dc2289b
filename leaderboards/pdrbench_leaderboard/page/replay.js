"use strict";
// A slider moves a spot along each track of a plan.
for (const figure of document.querySelectorAll(".replay")) {
  const track = JSON.parse(figure.dataset.track);
  const slider = figure.querySelector("input");
  const time = figure.querySelector("output");
  const names = ["real", "a", "b"];
  const spots = names.map((name) => figure.querySelector(`.spot.${name}`));

  function show() {
    const row = Number(slider.value);
    time.textContent = `${track.t_s[row]} s`;
    spots.forEach((spot, index) => {
      const [x, y] = track[names[index]][row];
      spot.removeAttribute("hidden");
      spot.setAttribute("cx", x);
      spot.setAttribute("cy", y);
    });
  }

  slider.max = track.t_s.length - 1;
  slider.hidden = false;
  slider.addEventListener("input", show);
  show();
}
