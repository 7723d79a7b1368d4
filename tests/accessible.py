"""What keeps a page from persons who cannot see or point: faults that axe-core names, and what Tab does not reach."""

from importlib.resources import files

import pytest

CONTROLS = """(root) => [...document.querySelectorAll(
    root + " :is(a[href], button, input, select, summary, [tabindex])")]
  .filter((e) => e.tabIndex >= 0 && !e.disabled && e.getClientRects().length
    && e.checkVisibility({ visibilityProperty: true }) && (e.type !== "radio" || e.checked))"""
"""Controls at which Tab stops: of a group of radio buttons the one that is chosen; arrow keys go to the others."""


SETTLED = """async () => {
  const begun = performance.now();
  let last = begun;
  const seen = new MutationObserver(() => { last = performance.now(); });
  seen.observe(document, { subtree: true, childList: true, attributes: true, characterData: true });
  while (performance.now() < Math.min(last + 1000, begun + 20_000)) await new Promise((done) => setTimeout(done, 50));
  seen.disconnect();
}"""


def settled(page):
    """Wait until nothing on a page has changed for a second; at most 20 s, for something may move for ever."""
    page.evaluate(SETTLED)


def faults(page, *rules):
    """Serious and critical faults that axe-core finds on a page as it is shown, each with the first place of it.

    They are those of all rules, or of some.
    """
    axe = pytest.importorskip("axe_playwright_python", reason="no axe-playwright-python, of the extra dev")
    page.evaluate((files(axe) / "axe.min.js").read_text(encoding="utf-8"))
    asked = {"resultTypes": ["violations"], **({"runOnly": list(rules)} if rules else {})}
    found = page.evaluate("(asked) => axe.run(document, asked)", asked)["violations"]
    return [(one["id"], one["nodes"][0]["html"][:200]) for one in found if one["impact"] in ("serious", "critical")]


def unreached(page, root="body"):
    """Controls within an element of a page at which Tab does not stop, going once through all of them."""
    page.evaluate(f"({CONTROLS})({root!r}).forEach((e) => e.setAttribute('data-unreached', ''))")
    left = page.evaluate(f"({CONTROLS})({root!r}).length")
    assert left > 0
    page.evaluate(f"({CONTROLS})({root!r})[0].focus()")
    for _ in range(2 * left + 50):  # between them Tab stops at what is in frames, and at boxes that scroll
        left = page.evaluate("""(() => {
          document.activeElement?.removeAttribute("data-unreached");
          return document.querySelectorAll("[data-unreached]").length;
        })()""")
        if not left:
            break
        page.keyboard.press("Tab")
    return page.evaluate("[...document.querySelectorAll('[data-unreached]')].map((e) => e.outerHTML.slice(0, 160))")
