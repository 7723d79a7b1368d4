// Mode shapes by plotly: the deformed structure, turnable, one mode at a time; only what is on the screen moves.
(() => {
  "use strict";
  if (!window.charts) return; // pictures then stay where shapes would be
  const PERIOD = 1800; // ms
  const REST = 20_000; // ms after which what nobody touches rests, so that an open page leaves the processor alone
  const UNIT = 0.507; // share of its height that a unit of a scene takes
  const AXES = ["x", "y", "z"];
  const EDGES = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((i) => [1, 2, 4].filter((b) => !(i & b)).map((b) => [i, i | b]));
  const UP = Math.PI / 2 - 1e-3; // as steep as a turntable goes
  const VIEWS = { top: [0, UP], side: [0, 0], end: [Math.PI / 2, 0] };

  function start(root) {
    const data = JSON.parse(root.querySelector("script").textContent);
    const plot = root.querySelector(".plot"), pick = (name) => root.querySelector(`[name=${name}]`);
    const size = Math.max(...AXES.map((_, k) => span(data.point.map((p) => p[k]))));
    let playing = !matchMedia("(prefers-reduced-motion: reduce)").matches;
    let visible = false, held = false, phase = 0, last = 0, frame = 0, until = 0, moving = [], view = data.view, turned = {};

    // What is drawn of the mode: in each scene the surface, its lines and points, and pale lines at rest.
    function panels() {
      const pair = data.pair[+pick("mode").value], what = pair.model ? pick("what").value : "measured";
      return what === "beside"
        ? [["measured", pair], ["model", pair]]
        : [[what, pair]];
    }

    function traces() {
      moving = [];
      const out = [], apart = pick("colour").value === "difference";
      for (const [place, [what, pair]] of panels().entries()) {
        const scene = place ? "scene2" : "scene", first = what === "model" ? "model" : "measured";
        const add = (trace, own) => {
          if (own) moving.push([out.length, own, pair]);
          out.push({ scene, showlegend: false, hoverinfo: "skip", ...trace });
        };
        add(lines(data.box ? corners(data.box) : data.point, data.box ? EDGES : data.line, "--rest", 2));
        const colour = apart && pair.model ? difference(pair) : displacement(pair, first);
        const bar = { title: { text: apart && pair.model ? "difference / largest" : "displacement / largest", side: "bottom", font: { size: 12 } },
          orientation: "h", thickness: 9, lenmode: "pixels", len: 170, x: 0.01, xanchor: "left", y: 0, yanchor: "bottom", nticks: 4 };
        const [i, j, k] = [0, 1, 2].map((c) => data.face.map((f) => f[c]));
        if (data.face.length) {
          add({ type: "mesh3d", ...columns(data.point), i, j, k, intensity: colour, cmin: 0, colorscale: "Viridis",
            cmax: apart && pair.model ? Math.max(0.1, ...colour) : 1, showscale: !place, colorbar: bar, flatshading: true,
            lighting: { ambient: 0.75, diffuse: 0.5, specular: 0.05 } }, { what: first });
        }
        add(lines(data.point, data.line, data.face.length ? "--ink" : `--${first}`, 3), { what: first, line: true });
        if (what === "both") add(lines(data.point, data.line, "--other", 5), { what: "model", line: true });
        const one = what === "both" ? ["measured", "model"] : [first];
        add({ type: "scatter3d", mode: pick("numbers").checked ? "markers+text" : "markers", ...columns(data.point),
          text: data.node, textposition: "top center", hoverinfo: undefined,
          customdata: data.point.map((_, p) => one.map((own) => `${own} ${displacement(pair, own)[p].toFixed(3)}`).join("<br>")),
          hovertemplate: "point %{text}<br>%{customdata}<extra></extra>",
          marker: { size: 3, color: charts.colour("--ink") } }, { what: first });
      }
      return out;
    }

    function lines(points, ends, colour, width) {
      return { type: "scatter3d", mode: "lines", line: { color: charts.colour(colour), width },
        ...columns(joined(points, ends)) };
    }

    // Positions of what moves at this phase, in plotly's terms of an update.
    function moved() {
      const swell = (size * data.swell * +pick("amplitude").value) / 1000, update = { x: [], y: [], z: [] };
      for (const [, own, pair] of moving) {
        const [re, im] = own.what === "model" ? [pair.model, null] : pair.measured;
        const c = swell * Math.cos(phase), s = im ? -swell * Math.sin(phase) : 0;
        const points = data.point.map((p, i) => AXES.map((_, k) => p[k] + c * re[3 * i + k] + (im ? s * im[3 * i + k] : 0)));
        const set = columns(own.line ? joined(points, data.line) : points);
        for (const a of AXES) update[a].push(set[a]);
      }
      return update;
    }

    // How a scene is seen: as its user turned it, else from a side, so large that the structure fills it.
    function seen() {
      const [azimuth, elevation] = view, own = ratio(ranges());
      const [cos, sin, up, flat] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)].map(Math.abs);
      const wide = own.x * cos + own.y * sin, high = own.z * up + (own.y * cos + own.x * sin) * flat;
      const many = panels().length, over = narrow() ? many : 1; // panels over each other
      const room = (plot.clientWidth * over * over) / (plot.clientHeight * many);
      const size = (0.96 / UNIT) * Math.min(room / wide, 1 / high);
      const aspectratio = Object.fromEntries(AXES.map((a) => [a, size * own[a]]));
      return { camera: eye(azimuth, elevation), aspectratio, ...turned };
    }

    const narrow = () => plot.clientWidth < 600;

    function ranges() {
      const room = 2 * size * data.swell * Math.max(1, +pick("amplitude").value);
      const points = data.box ? [...data.point, ...corners(data.box)] : data.point;
      return AXES.map((_, k) => {
        const own = points.map((p) => p[k]), half = 0.5 * (span(own) + room), middle = Math.max(...own) - 0.5 * span(own);
        return [middle - half, middle + half];
      });
    }

    function layout() {
      const own = ranges();
      const scene = { aspectmode: "manual", dragmode: "turntable", ...seen() };
      for (const [k, a] of AXES.entries()) scene[`${a}axis`] = { range: own[k], visible: false };
      const out = { height: plot.clientHeight, margin: { l: 0, r: 0, t: 0, b: 0 }, scene };
      if (panels().length > 1) {
        const [first, second] = [[0, 0.495], [0.505, 1]];
        out.scene = { ...scene, domain: narrow() ? { x: [0, 1], y: second } : { x: first, y: [0, 1] } };
        out.scene2 = { ...scene, domain: narrow() ? { x: [0, 1], y: first } : { x: second, y: [0, 1] } };
        out.annotations = (data.names || ["measured", "model"]).map((text, k) => ({
          text, xref: "paper", yref: "paper", showarrow: false,
          ...(narrow() ? { x: 0.03, xanchor: "left", y: 0.98 - 0.5 * k } : { x: 0.25 + 0.5 * k, y: 0.98 }),
        }));
      }
      return charts.themed(out);
    }

    let Plotly = null;
    async function draw() {
      const first = !Plotly;
      Plotly ??= await charts.renderer();
      const drawn = traces(), at = moved();
      moving.forEach(([place], n) => { for (const a of AXES) drawn[place][a] = at[a][n]; });
      await Plotly.react(plot, drawn, layout(), { responsive: true, displaylogo: false, scrollZoom: false });
      if (!first) return;
      plot.on("plotly_relayout", (change) => {
        const own = ["scene", "scene2"].filter((name) => `${name}.camera` in change);
        if (own.length !== 1) return; // not by hand
        turned = { camera: change[`${own[0]}.camera`] };
        if (`${own[0]}.aspectratio` in change) turned.aspectratio = change[`${own[0]}.aspectratio`];
        if (panels().length > 1) look();
      });
      plot.addEventListener("pointerdown", () => { held = true; });
      addEventListener("pointerup", () => { held = false; });
    }

    function look() {
      const change = {};
      for (const name of ["scene", "scene2"].slice(0, panels().length)) {
        for (const [key, value] of Object.entries(seen())) change[`${name}.${key}`] = value;
      }
      Plotly.relayout(plot, change);
    }

    async function tick(now) {
      if (!playing || !visible || now > until) { frame = 0; label(); return; }
      phase += (2 * Math.PI * Math.min(now - last, 100)) / PERIOD;
      last = now;
      if (!held) await Plotly.restyle(plot, moved(), moving.map(([place]) => place));
      frame = requestAnimationFrame(tick);
    }
    function stir() {
      last = performance.now();
      until = last + REST;
      if (playing && visible && !frame) { frame = requestAnimationFrame(tick); label(); }
    }
    async function wake() {
      await draw();
      stir();
    }

    const play = root.querySelector("[data-do=play]"), label = () => { play.textContent = frame ? "Pause" : "Play"; };
    play.addEventListener("click", () => { playing = !frame; stir(); });
    plot.addEventListener("pointermove", () => { if (playing) stir(); });
    for (const button of root.querySelectorAll("[data-view]")) {
      button.addEventListener("click", () => {
        view = VIEWS[button.dataset.view] ?? data.view;
        turned = {};
        look();
      });
    }
    plot.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
      if (!step) return;
      e.preventDefault();
      const { x, y, z } = seen().camera.eye;
      const up = Math.min(UP, Math.max(-UP, Math.atan2(z, Math.hypot(x, y)) + step[1]));
      turned = { ...turned, camera: eye(Math.atan2(x, -y) + step[0], up) };
      look();
    });
    root.querySelectorAll("select, input").forEach((own) => own.addEventListener("input", () => { choose(); wake(); }));
    root.querySelectorAll(".shape").forEach((own, k) => own.querySelector("button")?.addEventListener("click", () => {
      pick("mode").value = k;
      choose();
      wake();
      plot.scrollIntoView({ block: "nearest" });
    }));
    function choose() {
      const k = +pick("mode").value;
      root.querySelectorAll(".shape").forEach((own, n) => own.toggleAttribute("data-chosen", n === k));
      for (const name of ["what", "colour"]) pick(name).disabled = !data.pair[k].model;
      plot.setAttribute("aria-label", pick("mode").selectedOptions[0].textContent);
    }
    addEventListener("message", (e) => { // a workbench sends another pair
      if (e.source !== parent || !e.data?.pair) return;
      data.pair[0] = e.data.pair;
      wake();
    });
    new IntersectionObserver(([entry]) => { visible = entry.isIntersecting; if (visible) wake(); }, { rootMargin: "100px" })
      .observe(plot);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { if (Plotly) draw(); });
    label();
    choose();
    root.classList.add("live");
  }

  const eye = (azimuth, elevation) => ({
    eye: { x: 2 * Math.sin(azimuth) * Math.cos(elevation), y: -2 * Math.cos(azimuth) * Math.cos(elevation),
      z: 2 * Math.sin(elevation) },
    center: { x: 0, y: 0, z: 0 }, up: { x: 0, y: 0, z: 1 }, projection: { type: "orthographic" },
  });
  const ratio = (ranges) => {
    const wide = Math.max(...ranges.map(([a, b]) => b - a));
    return Object.fromEntries(AXES.map((a, k) => [a, (ranges[k][1] - ranges[k][0]) / wide]));
  };
  const displacement = (pair, what) => {
    const [re, im] = what === "model" ? [pair.model, null] : pair.measured;
    return length((i) => Math.hypot(re[i], im ? im[i] : 0), re.length / 3);
  };
  const difference = (pair) =>
    length((i) => Math.hypot(pair.measured[0][i] - pair.model[i], pair.measured[1][i]), pair.model.length / 3);
  const length = (of, n) => Array.from({ length: n }, (_, i) => Math.hypot(of(3 * i), of(3 * i + 1), of(3 * i + 2)) / 1000);
  const columns = (points) => Object.fromEntries(AXES.map((a, k) => [a, points.map((p) => p[k])]));
  const joined = (points, ends) => ends.flatMap(([a, b]) => [points[a], points[b], [null, null, null]]);
  const corners = (box) => [0, 1, 2, 3, 4, 5, 6, 7].map((i) => box.map((s, k) => (i & (1 << k) ? s : -s) / 2));
  const span = (v) => Math.max(...v) - Math.min(...v);

  document.querySelectorAll(".gallery").forEach(start);
})();
