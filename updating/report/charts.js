// Charts by plotly, which the page holds once, compressed; each is drawn when it first comes into view.
(() => {
  "use strict";
  if (!("DecompressionStream" in window)) return; // pictures then stay where charts would be
  const CONFIG = {
    responsive: true, displaylogo: false, scrollZoom: false,
    modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"],
  };

  async function unpacked(node) {
    const bytes = Uint8Array.from(atob(node.textContent.trim()), (c) => c.charCodeAt(0));
    return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  }

  let ready = null;
  function renderer() {
    ready ??= unpacked(document.getElementById("plotly")).then((code) => {
      const script = document.createElement("script");
      script.textContent = code;
      document.head.append(script);
      return window.Plotly;
    });
    return ready;
  }

  const AWAY = 1.15; // of the distance on a wide screen
  const MARGIN = { l: 56, r: 8, t: 34, b: 40 }; // px; titles and numbers of axes push them apart where they need more

  const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

  // The page's own colours, so that a chart follows light and dark.
  function themed(layout, legend = true) {
    const ink = colour("--ink"), line = colour("--line");
    const out = {
      ...layout, autosize: true, margin: { ...MARGIN, ...layout.margin }, paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: ink, size: 12, family: getComputedStyle(document.body).fontFamily },
      hoverlabel: { bgcolor: colour("--band"), bordercolor: line, font: { color: ink } },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: colour("--soft"), activecolor: colour("--accent") },
    };
    // A legend above the axes stands below the toolbar, which is at the very top.
    if (legend && layout.legend?.orientation === "h" && (layout.legend.y ?? 0) >= 1) {
      out.margin = { ...out.margin, t: Math.max(out.margin.t, innerWidth < 600 ? 96 : 64) };
      if (layout.height) out.height = layout.height + 34;
    }
    const own = { gridcolor: line, zerolinecolor: colour("--soft"), linecolor: colour("--soft") };
    for (const key of Object.keys(layout)) if (/^[xy]axis\d*$/.test(key)) out[key] = { ...layout[key], ...own };
    for (const scene of Object.keys(layout).filter((key) => key.startsWith("scene"))) {
      // A body is seen from as far as its height asks: on a phone the ends of a long one would be cut.
      out[scene] = { ...layout[scene] };
      if (innerWidth < 600) {
        out.height = 0.6 * innerWidth;
        const eye = layout[scene].camera?.eye;
        if (eye) out[scene].camera = { ...layout[scene].camera, eye: { x: AWAY * eye.x, y: AWAY * eye.y, z: AWAY * eye.z } };
      }
      for (const key of ["xaxis", "yaxis", "zaxis"]) {
        out[scene][key] = { ...layout[scene][key], ...own, backgroundcolor: "rgba(0,0,0,0)" };
      }
    }
    return out;
  }

  window.charts = { renderer, themed, colour }; // for the shapes

  // A chart with a choice holds numbers of every function, of which one is drawn.
  function drawn(spec, place) {
    return spec.functions ? oneFunction(spec, place) : spec;
  }

  const KIND = { i2: Int16Array, u1: Uint8Array };
  function numbers(packed) {
    const bytes = Uint8Array.from(atob(packed.bdata), (c) => c.charCodeAt(0));
    return Array.from(new KIND[packed.dtype](bytes.buffer), (v) => v * packed.step);
  }

  function oneFunction(spec, place) {
    const own = spec.functions[place], traces = [];
    const values = own.curves.map((c) => ({ size: numbers(c.size).map((v) => 10 ** v), phase: numbers(c.phase) }));
    const [measured, modes] = values;
    const rest = measured.size.map((a, k) => {
      const b = modes.size[k], turn = ((measured.phase[k] - modes.phase[k]) * Math.PI) / 180;
      return Math.sqrt(Math.max(0, a * a + b * b - 2 * a * b * Math.cos(turn)));
    });
    const line = (y, name, style, more) => ({
      type: "scatter", mode: "lines", x: spec.frequency, y, name, line: style, hovertemplate: "%{y:.4~g}", ...more,
    });
    traces.push(line(rest, spec.left.name, spec.left.line, {}));
    const shown = document.querySelector("[name=model]:checked")?.value ?? "found"; // of two models, by the page's switch
    own.curves.forEach((c, k) => {
      const visible = (spec.curves[k].of ?? shown) === shown || "legendonly";
      traces.push(line(values[k].size, spec.curves[k].name, spec.curves[k].line, { legendgroup: k, visible }));
      traces.push(line(values[k].phase, spec.curves[k].name, spec.curves[k].line,
        { yaxis: "y2", legendgroup: k, showlegend: false, mode: "markers", visible,
          marker: { size: 3, color: spec.curves[k].line.color }, hovertemplate: "%{y:.0f}°" }));
    });
    if (own.coherence) {
      traces.push(line(numbers(own.coherence), "coherence", { width: 1, color: colour("--soft") },
        { yaxis: "y3", showlegend: false }));
    }
    return { data: traces, layout: spec.layout };
  }

  async function start(root) {
    const spec = JSON.parse(await unpacked(root.querySelector("script")));
    if (spec.lines) spec.frequency = Array.from({ length: spec.lines.n }, (_, k) => spec.lines.first + k * spec.lines.step);
    const Plotly = await renderer();
    const plot = root.querySelector(".plot"), choice = root.querySelector("select");
    const figure = () => {
      const { data, layout } = drawn(spec, choice ? +choice.value : 0);
      const named = data.filter((t) => t.name && t.showlegend !== false);
      return [data, themed(layout, named.length > 1 || layout.showlegend === true)];
    };
    root.classList.add("live");
    await Plotly.newPlot(plot, ...figure(), CONFIG);
    if (choice) choice.addEventListener("change", () => Plotly.react(plot, ...figure(), CONFIG));
    if (spec.curves?.some((c) => c.of)) {
      for (const own of document.querySelectorAll("[name=model]")) {
        own.addEventListener("change", () => Plotly.react(plot, ...figure(), CONFIG));
      }
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change",
      () => Plotly.react(plot, ...figure(), CONFIG));
  }

  const seen = new IntersectionObserver((entries) => {
    for (const e of entries) if (e.isIntersecting) { seen.unobserve(e.target); start(e.target); }
  }, { rootMargin: "400px" });
  for (const root of document.querySelectorAll(".chart")) seen.observe(root);
  for (const link of document.querySelectorAll("a[data-point]")) {
    link.addEventListener("click", () => { // shows the function of a point where it leads
      const choice = document.querySelector(`${link.getAttribute("href")} .choice select`);
      const own = [...(choice?.options ?? [])].find((o) => new RegExp(`^${link.dataset.point}[+-]`).test(o.textContent));
      if (!own) return;
      choice.value = own.value;
      choice.dispatchEvent(new Event("change"));
    });
  }
  for (const button of document.querySelectorAll(".command button")) {
    button.addEventListener("click", async () => {
      const text = button.parentElement.querySelector("code").textContent;
      try {
        await navigator.clipboard.writeText(text);
      } catch { // a page that is a file may not be allowed to
        const range = document.createRange();
        range.selectNodeContents(button.parentElement.querySelector("code"));
        getSelection().removeAllRanges();
        getSelection().addRange(range);
        document.execCommand("copy");
      }
      button.textContent = "Copied";
    });
  }
})();
