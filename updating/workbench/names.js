// Names for a screen reader, where the widgets of the page give none: sliders and their values, boxes to tick,
// progress, tooltips, and the title.
(() => {
  const name = (selector, text) => {
    for (const node of document.querySelectorAll(selector)) {
      if (node.hasAttribute("aria-label") || node.hasAttribute("aria-labelledby")) continue;
      const said = text(node)?.trim();
      if (said) node.setAttribute("aria-label", said);
    }
  };
  const ofSlider = (thumb) => {
    const own = thumb.closest(".v-input"), thumbs = [...(own?.querySelectorAll(".v-slider-thumb") ?? [])];
    const beside = thumb.closest(".slider")?.querySelector(".text-body-2")?.textContent.split("=")[0];
    const said = own?.querySelector("label")?.textContent || own?.getAttribute("aria-label") || beside;
    return thumbs.length > 1 ? `${said}, ${thumbs.indexOf(thumb) ? "upper" : "lower"} end` : said;
  };
  const beside = (node) => node.closest(".slider").querySelector(".text-body-2")?.textContent.split("=") ?? [];
  const names = () => {
    name(".v-slider-thumb", ofSlider);
    for (const thumb of document.querySelectorAll(".slider .v-slider-thumb")) { // its own numbers are steps
      const value = (beside(thumb)[1] ?? "").trim();
      if (thumb.getAttribute("aria-valuetext") !== value) thumb.setAttribute("aria-valuetext", value);
    }
    for (const box of document.querySelectorAll(".v-table__wrapper")) { // arrow keys move what is wider than the page
      if (!box.hasAttribute("tabindex")) box.tabIndex = 0;
    }
    name("[role=progressbar]", () => "Work goes on");
    name("[role=tooltip]", (node) => node.textContent || "Hint");
    for (const title of document.querySelectorAll(".v-toolbar-title")) {
      title.setAttribute("role", "heading");
      title.setAttribute("aria-level", "1");
    }
  };
  let wait = 0;
  const soon = () => {
    wait ||= setTimeout(() => { wait = 0; names(); }, 300);
  };
  new MutationObserver(soon).observe(document.body, { childList: true, characterData: true, subtree: true });
  soon();
})();
