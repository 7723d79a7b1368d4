// Mode shapes drawn on 2-D canvases: one renderer for all; only those on the screen are drawn.
(() => {
  "use strict";
  const COLOUR = {};
  const dark = matchMedia("(prefers-color-scheme: dark)");
  function readColours() {
    const style = getComputedStyle(document.documentElement);
    for (const name of ["rest", "measured", "model", "soft"]) COLOUR[name] = style.getPropertyValue(`--${name}`).trim();
  }
  readColours();
  const PERIOD = 1800; // ms

  function start(root) {
    const data = JSON.parse(root.querySelector("script").textContent);
    const size = Math.max(...[0, 1, 2].map((k) => span(data.point.map((p) => p[k]))));
    const state = {
      azimuth: data.view[0], elevation: data.view[1], amplitude: 1, phase: 0,
      playing: !matchMedia("(prefers-reduced-motion: reduce)").matches,
    };
    const visible = new Set();
    const canvases = [...root.querySelectorAll("canvas")];
    let frame = 0, last = 0;

    const drawAll = () => visible.forEach((canvas) => draw(canvas, data, state, size));
    function tick(now) {
      frame = 0;
      if (!state.playing || !visible.size) return;
      state.phase += (2 * Math.PI * Math.min(now - last, 100)) / PERIOD;
      last = now;
      drawAll();
      frame = requestAnimationFrame(tick);
    }
    function wake() {
      drawAll();
      if (state.playing && !frame) { last = performance.now(); frame = requestAnimationFrame(tick); }
    }

    const seen = new IntersectionObserver((entries) => {
      for (const e of entries) e.isIntersecting ? visible.add(e.target) : visible.delete(e.target);
      wake();
    });
    for (const canvas of canvases) { seen.observe(canvas); turnable(canvas, state, data.view, wake); }
    addEventListener("resize", drawAll);
    dark.addEventListener("change", () => { readColours(); drawAll(); });

    const play = root.querySelector("[data-do=play]");
    const label = () => { play.textContent = state.playing ? "Pause" : "Play"; };
    play.addEventListener("click", () => { state.playing = !state.playing; label(); wake(); });
    root.querySelector("[data-do=reset]").addEventListener("click", () => view(data.view));
    root.querySelector("[data-do=top]").addEventListener("click", () => view([0, Math.PI / 2]));
    root.querySelector("[data-do=side]").addEventListener("click", () => view([0, 0]));
    root.querySelector("[data-do=end]").addEventListener("click", () => view([Math.PI / 2, 0]));
    root.querySelector("input").addEventListener("input", (e) => { state.amplitude = +e.target.value; wake(); });
    function view([azimuth, elevation]) { Object.assign(state, { azimuth, elevation }); wake(); }
    label();
    root.classList.add("live");
  }

  function turnable(canvas, state, home, wake) {
    canvas.addEventListener("pointerdown", (e) => { canvas.setPointerCapture(e.pointerId); });
    canvas.addEventListener("pointermove", (e) => {
      if (e.buttons) turn(-e.movementX * 0.01, e.movementY * 0.01);
    });
    canvas.addEventListener("dblclick", () => { [state.azimuth, state.elevation] = home; wake(); });
    canvas.addEventListener("keydown", (e) => {
      const step = { ArrowLeft: [0.1, 0], ArrowRight: [-0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] }[e.key];
      if (step) { e.preventDefault(); turn(...step); }
    });
    function turn(a, b) {
      state.azimuth += a;
      state.elevation = Math.max(-Math.PI / 2, Math.min(Math.PI / 2, state.elevation + b));
      wake();
    }
  }

  function draw(canvas, data, state, size) {
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const to = projection(data.point, state, size * data.swell * state.amplitude, width, height);
    const c = canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, height);
    c.lineCap = "round";
    const pair = data.pair[+canvas.dataset.pair], what = canvas.dataset.what;
    if (data.box) wire(c, corners(data.box).map(to), EDGES, COLOUR.rest, 1, 0);
    wire(c, data.point.map(to), data.line, COLOUR.rest, 1, data.line.length ? 1 : 3);
    const swell = (size * data.swell * state.amplitude) / 1000;
    const real = swell * Math.cos(state.phase), imaginary = -swell * Math.sin(state.phase);
    if (what !== "model") {
      const [re, im] = pair.measured;
      wire(c, moved((k) => real * re[k] + imaginary * im[k]).map(to), data.line, COLOUR.measured, 3.6, 2.8);
    }
    if (what !== "measured" && pair.model) {
      wire(c, moved((k) => real * pair.model[k]).map(to), data.line, COLOUR.model, 1.3, 1.9);
    }
    axes(c, state, width - 30, height - 24);
    function moved(by) {
      return data.point.map((p, i) => [p[0] + by(3 * i), p[1] + by(3 * i + 1), p[2] + by(3 * i + 2)]);
    }
  }

  // Without perspective: right, up and depth of a point, scaled so that the structure fills the canvas.
  function turned([x, y, z], { azimuth, elevation }) {
    const depth = y * Math.cos(azimuth) - x * Math.sin(azimuth);
    return [
      x * Math.cos(azimuth) + y * Math.sin(azimuth),
      z * Math.cos(elevation) + depth * Math.sin(elevation),
      depth * Math.cos(elevation) - z * Math.sin(elevation),
    ];
  }

  function projection(points, state, margin, width, height) {
    const all = points.map((p) => turned(p, state));
    const middle = [0, 1].map((k) => centre(all.map((p) => p[k])));
    const scale = Math.min(...[width - 16, height - 16].map((s, k) => s / (span(all.map((p) => p[k])) + 2 * margin)));
    const near = centre(all.map((p) => p[2])), deep = span(all.map((p) => p[2])) || 1;
    return (p) => {
      const [x, y, depth] = turned(p, state);
      const front = Math.max(0, Math.min(1, 0.5 - (depth - near) / deep));
      return [width / 2 + scale * (x - middle[0]), height / 2 - scale * (y - middle[1]), front];
    };
  }

  // What is farther away is paler, so that the eye sees which way the shape turns.
  function wire(c, points, lines, colour, width, radius) {
    c.strokeStyle = c.fillStyle = colour;
    c.lineWidth = width;
    for (const [a, b] of lines) {
      const [x, y, front] = points[a], [u, v, other] = points[b];
      c.globalAlpha = 0.45 + 0.275 * (front + other);
      c.beginPath(); c.moveTo(x, y); c.lineTo(u, v); c.stroke();
    }
    c.globalAlpha = 1;
    if (!radius) return;
    for (const [x, y] of points) { c.beginPath(); c.arc(x, y, radius, 0, 7); c.fill(); }
  }

  function axes(c, state, left, low) {
    c.strokeStyle = c.fillStyle = COLOUR.soft;
    c.lineWidth = 1;
    c.font = "10px sans-serif";
    for (const [k, name] of ["x", "y", "z"].entries()) {
      const [x, y] = turned([0, 1, 2].map((i) => (i === k ? 16 : 0)), state);
      c.beginPath(); c.moveTo(left, low); c.lineTo(left + x, low - y); c.stroke();
      if (Math.hypot(x, y) > 5) c.fillText(name, left + 1.3 * x - 3, low - 1.3 * y + 3);
    }
  }

  const EDGES = [0, 1, 2, 3, 4, 5, 6, 7].flatMap((i) => [1, 2, 4].filter((b) => !(i & b)).map((b) => [i, i | b]));
  const corners = (box) => [0, 1, 2, 3, 4, 5, 6, 7].map((i) => box.map((s, k) => (i & (1 << k) ? s : -s) / 2));
  const span = (v) => Math.max(...v) - Math.min(...v);
  const centre = (v) => (Math.max(...v) + Math.min(...v)) / 2;

  document.querySelectorAll(".gallery").forEach(start);
})();
