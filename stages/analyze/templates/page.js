"use strict";
// Draws every chart in the page's colours, and again when the reader's colour scheme changes.
(() => {
  const { themes, figures } = JSON.parse(document.getElementById("charts").textContent);
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const draw = () => {
    for (const element of document.querySelectorAll(".chart")) {
      const specification = figures[element.dataset.chart][Number(element.dataset.panel)];
      const options = {
        actions: false,
        renderer: "svg",
        config: dark.matches ? themes.dark : themes.light,
        tooltip: { theme: dark.matches ? "dark" : "light" },
      };
      window.vegaEmbed(element, specification, options).catch((error) => {
        element.textContent = `This chart cannot be drawn: ${error.message}`;
      });
    }
  };
  dark.addEventListener("change", draw);
  draw();
})();
