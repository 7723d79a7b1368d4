// On a phone each part of the page but the answer is folded to its heading; a tap, or a link into it, opens it.
(() => {
  "use strict";
  const narrow = matchMedia("(max-width: 720px)");
  const parts = [...document.querySelectorAll("main section:not(#answer)")];
  if (parts.length < 2) return;

  const all = document.createElement("button");
  all.type = "button";
  all.className = "all-parts";
  const isOpen = (part) => part.classList.contains("unfolded");
  const set = (part, open) => {
    part.classList.toggle("unfolded", open);
    part.querySelector(":scope > :first-child > button")?.setAttribute("aria-expanded", open);
    all.textContent = parts.every(isOpen) ? "Close all parts" : "Open all parts";
  };
  all.addEventListener("click", () => {
    const open = !parts.every(isOpen);
    for (const part of parts) set(part, open);
  });
  const reveal = (node) => {
    for (let part = node?.closest("section"); part; part = part.parentElement.closest("section")) set(part, true);
  };

  // Headings are buttons only where they fold something: elsewhere the keyboard has nothing to stop at.
  function arrange() {
    for (const part of parts) {
      const heading = part.firstElementChild, button = heading.querySelector(":scope > button");
      part.classList.toggle("folds", narrow.matches);
      if (narrow.matches && !button) {
        const made = document.createElement("button");
        made.type = "button";
        made.append(...heading.childNodes);
        made.addEventListener("click", () => set(part, !isOpen(part)));
        heading.append(made);
        set(part, isOpen(part));
      } else if (!narrow.matches && button) button.replaceWith(...button.childNodes);
    }
    if (narrow.matches) parts[0].before(all);
    else all.remove();
  }
  narrow.addEventListener("change", arrange);
  const named = () => document.getElementById(decodeURIComponent(location.hash.slice(1)));
  const follow = () => {
    const to = named();
    if (!to || !narrow.matches) return;
    reveal(to);
    to.scrollIntoView();
  };
  document.addEventListener("click", (e) => { // also where the address has that place already
    const to = e.target.closest?.("a[href^='#']")?.getAttribute("href");
    if (to) reveal(document.getElementById(to.slice(1)));
  });
  addEventListener("hashchange", follow);
  arrange();
  follow();
})();
