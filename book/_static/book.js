"use strict";
// What the theme leaves open: scenes that turn dark with the page, solutions that fold, a search that works from a disk.
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
  // A tap beside a scene that a finger turns lets go of it; what is touched inside a frame is not heard here.
  addEventListener("pointerdown", () => frames().forEach((frame) => frame.contentWindow?.postMessage({ gvpScene: "release" }, "*")));

  // A laboratory loads only when somebody starts it; until then its still stands.
  document.querySelectorAll(".gvp-lab button").forEach((button) => button.addEventListener("click", () => {
    const place = button.parentElement, frame = document.createElement("iframe");
    Object.assign(frame, { src: place.dataset.page + location.hash, title: place.querySelector("img").alt });
    frame.style.height = `${place.dataset.height}px`;
    frame.allow = "clipboard-write";
    place.classList.add("gvp-scene", "started");
    place.replaceChildren(frame);
    frame.addEventListener("load", tell);
    frame.focus();
  }));

  // The search page reads each page it found, to quote from it. From file:// it may not, and finds without quoting.
  if (location.protocol === "file:" && typeof DOCUMENTATION_OPTIONS === "object") {
    DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;
  }

  // The arrows that unfold the table of contents have no name for those who cannot see them.
  document.querySelectorAll("summary:has(> .toctree-toggle)").forEach((arrow) => {
    const above = arrow.closest("li").querySelector("a");
    arrow.setAttribute("aria-label", `Pages of: ${above.textContent.trim()}`);
  });

  // Solutions, and whatever else has the class "dropdown", are folded away; a click or Enter opens them.
  document.querySelectorAll(".admonition.dropdown").forEach((box) => {
    const title = box.querySelector(".admonition-title");
    if (!title) return;
    const details = document.createElement("details"), summary = document.createElement("summary");
    // A link inside a button would be two controls in one; the exercise stands right above.
    title.querySelectorAll("a").forEach((link) => link.replaceWith(...link.childNodes));
    details.append(summary, ...[...box.childNodes].filter((node) => node !== title));
    summary.append(title);
    box.append(details);
  });
})();
