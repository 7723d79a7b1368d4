// Each panel is an entry of the browser's history: back and forward go through the panels, and F5 stays in one.
(() => {
  const begin = () => {
    const state = window.trame?.state;
    if (!state) {
      setTimeout(begin, 50);
      return;
    }
    const named = () => decodeURIComponent(location.hash.slice(1));
    addEventListener("popstate", () => named() && state.set("panel", named()));
    state.watch(["panel"], (panel) => {
      if (!panel || panel === named()) return;
      const place = `${location.pathname}#${encodeURIComponent(panel)}`;
      history[location.hash ? "pushState" : "replaceState"](history.state, "", place);
    });
  };
  begin();
})();

// The page of the server forbids to enlarge it; whoever sees badly needs that.
document.querySelector("meta[name=viewport]")?.setAttribute("content", "width=device-width, initial-scale=1");
