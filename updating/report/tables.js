// Tables sort by a click on a heading: by the number that a cell starts with, else by its text; empty cells last.
(() => {
  "use strict";
  // "12.3 ± 0.4", "(1.20 ± 0.05)e-11", "-0.01", "323 | 321"
  const NUMBER = /^\(?([-+]?\d[\d.]*(?:e[-+]?\d+)?)(?:[^)]*\)e([-+]?\d+))?/i;

  function value(cell) {
    const found = NUMBER.exec(cell.textContent.trim());
    return found ? parseFloat(found[1]) * 10 ** +(found[2] || 0) : NaN;
  }

  function sort(table, column, up) {
    const body = table.tBodies[0], rows = [...body.rows];
    const text = (row) => row.cells[column].textContent.trim();
    const filled = rows.filter(text), empty = rows.filter((row) => !text(row));
    const numeric = filled.every((row) => !Number.isNaN(value(row.cells[column])));
    const compare = numeric
      ? (a, b) => value(a.cells[column]) - value(b.cells[column])
      : (a, b) => text(a).localeCompare(text(b), undefined, { numeric: true });
    filled.sort((a, b) => (up ? 1 : -1) * compare(a, b));
    body.append(...filled, ...empty);
  }

  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      head.tabIndex = 0;
      const act = () => {
        const up = head.getAttribute("aria-sort") !== "ascending";
        heads.forEach((h) => h.removeAttribute("aria-sort"));
        head.setAttribute("aria-sort", up ? "ascending" : "descending");
        sort(table, column, up);
      };
      head.addEventListener("click", act);
      head.addEventListener("keydown", (e) => {
        if (e.key === "Enter" || e.key === " ") { e.preventDefault(); act(); }
      });
    });
  }
})();

// Where rows are cards, on a phone, long tables show the first ones and a button for the rest.
(() => {
  "use strict";
  const SHOWN = 4;
  for (const table of document.querySelectorAll("table")) {
    const more = (table.tBodies[0]?.rows.length ?? 0) - SHOWN;
    if (more < 2) continue;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "rest";
    button.textContent = `Show ${more} more`;
    button.addEventListener("click", () => { table.classList.remove("short"); button.remove(); });
    table.classList.add("short");
    table.after(button);
  }
})();

// What is printed says when; the page itself, made from the same results, is always the same.
(() => {
  "use strict";
  const printed = document.querySelector(".about .printed");
  if (!printed) return;
  printed.querySelector("dd").textContent = new Date().toLocaleDateString("en-GB", { dateStyle: "long" });
  printed.hidden = false;
})();
