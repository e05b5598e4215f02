"use strict";
// Tells each 3D scene on the page whether the book is light or dark, and shows the still where 3D is not to be had.
(() => {
  const theme = () => ({ gvpTheme: document.documentElement.dataset.theme === "dark" ? "dark" : "light" });
  const frames = () => [...document.querySelectorAll(".gvp-scene iframe")];
  // From file:// a page may not look into another, so the two talk by messages.
  addEventListener("message", (event) => {
    const frame = frames().find((candidate) => candidate.contentWindow === event.source);
    if (!frame || !event.data) return;
    if (event.data.gvpScene === "ready") frame.contentWindow.postMessage(theme(), "*");
    if (event.data.gvpScene === "failed") frame.parentElement.classList.add("still");
  });
  const tell = () => frames().forEach((frame) => frame.contentWindow?.postMessage(theme(), "*"));
  new MutationObserver(tell).observe(document.documentElement, { attributeFilter: ["data-theme"] });
  frames().forEach((frame) => frame.addEventListener("load", tell));

  // Solutions, and whatever else has the class "dropdown", are folded away; a click or Enter opens them.
  document.querySelectorAll(".admonition.dropdown").forEach((box) => {
    const title = box.querySelector(".admonition-title");
    if (!title) return;
    const details = document.createElement("details"), summary = document.createElement("summary");
    details.append(summary, ...[...box.childNodes].filter((node) => node !== title));
    summary.append(title);
    box.append(details);
  });
})();
