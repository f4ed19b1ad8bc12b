// The script of a page: folds its sections and draws its live charts with uPlot. Without it the page shows all of its
// text and the printed figures. It makes every element itself and sets texts by textContent, never as HTML.
"use strict";

// ---- Folding: sections are open in the file, so that they are read without scripts and printed.

const folds = [...document.querySelectorAll("details")].filter((fold) => !fold.closest("td"));
const unfold = (element) => {
  for (let at = element; at; at = at.parentElement) if (at.tagName === "DETAILS") at.open = true;
};
for (const fold of folds) fold.open = false;
let opened = [];
addEventListener("beforeprint", () => {
  opened = folds.filter((fold) => !fold.open);
  for (const fold of opened) fold.open = true;
});
addEventListener("afterprint", () => { for (const fold of opened) fold.open = false; });
const unfoldTarget = () => {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  unfold(target);
  if (target) target.scrollIntoView();
};
addEventListener("hashchange", unfoldTarget);
if (location.hash) unfoldTarget();

// ---- Elements

function make(tag, parent, text = "", className = "") {
  const element = document.createElement(tag);
  if (text) element.textContent = text;
  if (className) element.className = className;
  parent.append(element);
  return element;
}

/** A sample of a line's look, for a switch: an SVG, so that dashes are seen as they are drawn. */
function sample(look, parent) {
  const space = "http://www.w3.org/2000/svg";
  const drawing = document.createElementNS(space, "svg");
  const line = document.createElementNS(space, "line");
  const attributes = {
    x1: 0, x2: 28, y1: 6, y2: 6, stroke: look.colour, "stroke-width": Math.max(look.width, 1.5),
    "stroke-dasharray": look.dash.join(" "),
  };
  for (const [name, value] of Object.entries(attributes)) line.setAttribute(name, value);
  drawing.setAttribute("width", 28);
  drawing.setAttribute("height", 12);
  drawing.setAttribute("aria-hidden", "true");
  drawing.append(line);
  parent.append(drawing);
}

// ---- Numbers

/** Gives each line of a chart its values, null where there is none: all low bytes and then all high bytes of the
 * differences of their 16-bit codes, compressed. */
async function unpack({ codes, samples, panels }) {
  const packed = Uint8Array.from(atob(codes), (letter) => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  const bytes = new Uint8Array(await new Response(stream).arrayBuffer());
  const half = bytes.length / 2;
  panels.flatMap((panel) => panel.lines).forEach((line, index) => {
    let code = 0;
    line.values = Array.from({ length: samples }, (_, k) => {
      const at = index * samples + k;
      code = (code + bytes[at] + 256 * bytes[half + at]) & 0xffff;
      // Codes are signed, -32768 for none.
      return code === 0x8000 ? null : line.low + ((((code + 32767) & 0xffff) / 65534) * (line.high - line.low));
    });
  });
}

/** Start and end of the parts of a run that lie in a bin of a regime's curve. */
function spansOf(regime, bin) {
  const codes = atob(regime.codes);
  const step = (regime.end - regime.start) / (codes.length - 1);
  const found = [];
  for (let k = 0, from = null; k <= codes.length; k++) {
    const inside = k < codes.length && codes.charCodeAt(k) === bin + 1;
    if (inside && from == null) from = k;
    if (!inside && from != null) {
      found.push([regime.start + from * step, regime.start + k * step]);
      from = null;
    }
  }
  return found;
}

const figure4 = (value) => (value == null ? "–" : String(Number(value.toPrecision(4))).replace("-", "−"));

// ---- A chart

const AXIS = { stroke: "#333", grid: { stroke: "#ddd", width: 1 }, ticks: { stroke: "#999", width: 1 } };
const HEIGHT = 150;
const LEFT = 62;

class LiveChart {
  constructor(figure, content) {
    this.content = content;
    this.on = Object.fromEntries(content.switches.map((each) => [each.key, each.on]));
    this.marked = [];
    this.window = [content.start, content.end];
    this.root = figure.querySelector(".chart");
    this.root.tabIndex = 0;
    this.root.setAttribute("role", "group");
    this.root.setAttribute("aria-label", `${content.heading}: chart. Arrow keys move, + and - zoom, 0 shows the whole run.`);
    this.addSwitches();
    this.readout = make("p", this.root, "", "readout");
    const step = (content.end - content.start) / (content.samples - 1);
    const time = Array.from({ length: content.samples }, (_, k) => content.start + k * step);
    this.plots = content.panels.map((panel, index) => this.addPanel(panel, index, time));
    this.strips = content.strips.length ? this.addStrips() : null;
    if (content.regimes.length) this.addRegimes();
    this.root.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.resize()).observe(this.root);
    this.show();
  }

  get width() { return Math.max(this.root.clientWidth - 2, 200); }

  shown(line) { return line.switches.every((key) => this.on[key]); }

  addSwitches() {
    const row = make("div", this.root, "", "switches");
    this.boxes = {};
    for (const each of this.content.switches) {
      const label = make("label", row);
      const box = make("input", label);
      box.type = "checkbox";
      box.checked = each.on;
      box.addEventListener("change", () => this.turn({ [each.key]: box.checked }));
      this.boxes[each.key] = box;
      if (each.colour) sample(each, label);
      make("span", label, each.label);
    }
    if (this.content.swap) {
      const [name, before, after] = this.content.swap;
      this.swap = make("button", row);
      this.swap.type = "button";
      this.swap.addEventListener("click", () => {
        const effect = !(this.on[after] && !this.on[before]);
        this.turn({ [before]: !effect, [after]: effect });
      });
      this.swapName = name;
    }
    const reset = make("button", row, "Whole run", "reset");
    reset.type = "button";
    reset.addEventListener("click", () => this.zoom(this.content.start, this.content.end));
  }

  /** Turn switches on or off: key -> whether it is on. */
  turn(keys) {
    Object.assign(this.on, keys);
    this.show();
  }

  show() {
    for (const [key, box] of Object.entries(this.boxes)) box.checked = this.on[key];
    if (this.swap) {
      const [, before, after] = this.content.swap;
      const effect = this.on[after] && !this.on[before];
      this.swap.setAttribute("aria-pressed", String(effect));
      this.swap.textContent = effect ? `Take out ${this.swapName}` : `Put in ${this.swapName}`;
    }
    this.plots.forEach((plot, index) => {
      plot.batch(() => this.content.panels[index].lines.forEach((line, k) => {
        if (plot.series[k + 1].show !== this.shown(line)) plot.setSeries(k + 1, { show: this.shown(line) });
      }));
    });
    this.read(null);
  }

  addPanel(panel, index, time) {
    const last = index === this.content.panels.length - 1;
    const title = make("p", this.root, `${panel.name} (${panel.unit})`, "panel");
    this.titles = [...(this.titles || []), title];
    const series = panel.lines.map((line) => ({
      label: line.label, show: this.shown(line), stroke: line.colour, width: line.width, dash: line.dash,
      points: { show: false }, paths: line.stepped ? uPlot.paths.stepped({ align: 1 }) : undefined,
    }));
    const options = {
      width: this.width, height: HEIGHT + (last ? 30 : 0), legend: { show: false }, series: [{}, ...series],
      scales: { x: { time: false }, y: { range: (plot, low, high) => this.range(plot, panel, low, high) } },
      axes: [
        { ...AXIS, size: last ? 46 : 8, label: last ? "time (s)" : undefined, labelSize: 18,
          values: last ? undefined : (plot, splits) => splits.map(() => "") },
        { ...AXIS, size: LEFT },
      ],
      padding: [6, 12, 0, 0],
      cursor: { sync: { key: this.content.id, setSeries: false, scales: ["x", null] }, drag: { x: true, y: false }, y: false },
      hooks: {
        drawClear: [(plot) => this.shade(plot)],
        setScale: [(plot, scale) => { if (scale === "x") this.follow(plot); }],
        setCursor: [(plot) => { if (plot === this.plots?.[0]) this.read(plot.cursor.idx); }],
      },
    };
    return new uPlot(options, [time, ...panel.lines.map((line) => line.values)], this.root);
  }

  /** Range of a panel: all that is shown; a run far from the measurement reaches one span beyond the rest at most. */
  range(plot, panel, low, high) {
    if (low == null) return [0, 1];
    const [first, last] = plot.series[0].idxs || [0, plot.data[0].length - 1];
    const rest = [Infinity, -Infinity];
    panel.lines.forEach((line, k) => {
      if (line.bounded || !this.shown(line)) return;
      for (let i = first; i <= last; i++) {
        const value = plot.data[k + 1][i];
        if (value != null) { rest[0] = Math.min(rest[0], value); rest[1] = Math.max(rest[1], value); }
      }
    });
    const span = rest[1] - rest[0];
    if (span > 0) { low = Math.max(low, rest[0] - span); high = Math.min(high, rest[1] + span); }
    const margin = 0.06 * (high - low) || Math.abs(low) || 1;
    return [low - margin, high + margin];
  }

  /** Held-out parts and the samples of a chosen bin, behind the lines. */
  shade(plot) {
    const { ctx, bbox } = plot;
    const band = (start, end, colour, least) => {
      const from = Math.max(plot.valToPos(start, "x", true), bbox.left);
      const to = Math.min(plot.valToPos(end, "x", true), bbox.left + bbox.width);
      if (to < bbox.left || from > bbox.left + bbox.width) return;
      ctx.fillStyle = colour;
      ctx.fillRect(from, bbox.top, Math.max(to - from, least), bbox.height);
    };
    ctx.save();
    for (const [start, end] of this.content.shaded) band(start, end, "#ececec", 0);
    for (const [start, end] of this.marked) band(start, end, "#f2c200aa", 1);
    ctx.restore();
  }

  /** Zoom all panels as one of them. */
  follow(plot) {
    const { min, max } = plot.scales.x;
    if (!this.plots || min == null || (min === this.window[0] && max === this.window[1])) return;
    this.zoom(min, max);
  }

  zoom(start, end) {
    const { start: first, end: last } = this.content;
    const span = Math.min(Math.max(end - start, (5 * (last - first)) / this.content.samples), last - first);
    start = Math.min(Math.max(start, first), last - span);
    this.window = [start, start + span];
    [this.root.dataset.from, this.root.dataset.to] = this.window;
    const [min, max] = this.window;
    for (const plot of this.plots) plot.setScale("x", { min, max });
    this.strips?.draw();
  }

  key(event) {
    if (event.target !== this.root || event.ctrlKey || event.metaKey || event.altKey) return;
    const [start, end] = this.window;
    const span = end - start;
    const moves = {
      ArrowLeft: [start - span / 5, end - span / 5], ArrowRight: [start + span / 5, end + span / 5],
      "+": [start + span / 4, end - span / 4], "=": [start + span / 4, end - span / 4],
      "-": [start - span / 2, end + span / 2], 0: [this.content.start, this.content.end],
    };
    if (!(event.key in moves)) return;
    event.preventDefault();
    this.zoom(...moves[event.key]);
  }

  /** The values below the cursor, above each panel. index: of the sample; null for none. */
  read(index) {
    if (!this.plots) return;
    const at = index == null ? null : this.plots[0].data[0][index];
    this.readout.textContent = at == null ? "Move over a panel to read its values." : `t = ${at.toFixed(3)} s`;
    this.content.panels.forEach((panel, k) => {
      const lines = panel.lines.map((line, j) => [line, this.plots[k].data[j + 1]]).filter(([line]) => this.shown(line));
      const values = at == null ? [] : lines.map(([line, data]) => `${line.label} ${figure4(data[index])}`);
      this.titles[k].textContent = `${panel.name} (${panel.unit})${values.length ? `: ${values.join(", ")}` : ""}`;
    });
  }

  /** Rows of bars below the panels. */
  addStrips() {
    const rows = this.content.strips.map((strip) => {
      make("p", this.root, strip.spans.length ? strip.label : `${strip.label}: never`, "panel");
      const canvas = strip.spans.length ? make("canvas", this.root, "", "strip") : null;
      if (canvas) canvas.setAttribute("role", "img");
      canvas?.setAttribute("aria-label", `${strip.label}: ${strip.spans.length} times`);
      return [strip, canvas];
    });
    const draw = () => {
      const [start, end] = this.window;
      for (const [strip, canvas] of rows) {
        if (!canvas) continue;
        const ratio = devicePixelRatio || 1;
        canvas.width = this.width * ratio;
        canvas.height = 12 * ratio;
        const pen = canvas.getContext("2d");
        const left = LEFT * ratio;
        const scale = (canvas.width - left - 12 * ratio) / (end - start);
        pen.fillStyle = "#f0f0f0";
        pen.fillRect(left, 0, (end - start) * scale, canvas.height);
        pen.fillStyle = strip.colour;
        for (const [from, to] of strip.spans) {
          const a = Math.max(from, start), b = Math.min(to, end);
          if (b > a) pen.fillRect(left + (a - start) * scale, 0, Math.max((b - a) * scale, 1), canvas.height);
        }
      }
    };
    draw();
    return { draw };
  }

  /** The curve of one regime; a click on a point, or the arrow keys, mark its samples in the panels. */
  addRegimes() {
    make("p", this.root, "What the unknown inputs depend on: choose a point to mark its samples above.", "panel");
    const choice = make("select", this.root);
    choice.setAttribute("aria-label", "Dependence of an unknown input");
    for (const regime of this.content.regimes) make("option", choice, regime.label);
    const place = make("div", this.root, "", "regime");
    place.tabIndex = 0;
    place.setAttribute("role", "group");
    place.setAttribute("aria-label", "Curve. Left and right arrow choose a point, Escape none.");
    const said = make("p", this.root, "", "readout");
    said.setAttribute("aria-live", "polite");
    let regime, plot, chosen;

    const choose = (index) => {
      chosen = index;
      this.marked = index == null ? [] : spansOf(regime, index);
      const [across, up] = index == null ? [] : regime.points[index];
      const seconds = this.marked.reduce((sum, [start, end]) => sum + end - start, 0);
      said.textContent = index == null ? "" :
        `Marked: ${regime.across} ${figure4(across)}, ${regime.up} ${figure4(up)}; ${figure4(seconds)} s of the run.`;
      this.root.dataset.marked = this.marked.length;
      for (const each of [...this.plots, plot]) each.redraw(false, false);
    };
    const draw = () => {
      regime = this.content.regimes[choice.selectedIndex];
      place.replaceChildren();
      const [across, mean, sd] = [0, 1, 2].map((k) => regime.points.map((point) => point[k]));
      const sides = [1, -1].map((sign) => mean.map((value, k) => value + sign * sd[k]));
      const span = across[across.length - 1] - across[0] || 1;
      const points = { show: true, size: 9, fill: "#d55e00", stroke: "#d55e00" };
      plot = new uPlot({
        width: Math.min(this.width, 560), height: 240, legend: { show: false }, padding: [8, 14, 0, 0],
        scales: { x: { time: false, range: () => [across[0] - 0.06 * span, across[across.length - 1] + 0.06 * span] } },
        series: [{}, { stroke: "#d55e00", width: 2, points }, ...sides.map(() => ({ stroke: "#d55e0088", dash: [3, 3], points: { show: false } }))],
        axes: [{ ...AXIS, label: regime.across, labelSize: 20 }, { ...AXIS, label: regime.unit, size: LEFT, labelSize: 20 }],
        cursor: { drag: { x: false, y: false }, y: false },
        hooks: { draw: [(self) => {
          if (chosen == null) return;
          const { ctx } = self;
          ctx.save();
          ctx.strokeStyle = "#000";
          ctx.setLineDash([]);
          ctx.lineWidth = 2 * (devicePixelRatio || 1);
          ctx.beginPath();
          ctx.arc(self.valToPos(across[chosen], "x", true), self.valToPos(mean[chosen], "y", true), 8 * (devicePixelRatio || 1), 0, 7);
          ctx.stroke();
          ctx.restore();
        }] },
      }, [across, mean, ...sides], place);
      plot.over.addEventListener("click", () => { if (plot.cursor.idx != null) choose(plot.cursor.idx); });
      choose(null);
    };
    place.addEventListener("keydown", (event) => {
      const last = regime.points.length - 1;
      if (event.key === "Escape") choose(null);
      else if (event.key === "ArrowRight") choose(chosen == null ? 0 : Math.min(chosen + 1, last));
      else if (event.key === "ArrowLeft") choose(chosen == null ? last : Math.max(chosen - 1, 0));
      else return;
      event.preventDefault();
    });
    choice.addEventListener("change", draw);
    draw();
  }

  resize() {
    if (this.drawn === this.width) return;
    this.drawn = this.width;
    this.plots.forEach((plot) => plot.setSize({ width: this.width, height: plot.height }));
    this.strips?.draw();
  }
}

if (window.uPlot) {
  document.querySelectorAll("figure.live").forEach(async (figure, index) => {
    const printed = figure.nextElementSibling;
    try {
      const content = JSON.parse(figure.querySelector("script").textContent);
      await unpack(content);
      figure.hidden = false;
      new LiveChart(figure, { ...content, id: `chart-${index}` });
      if (printed?.classList.contains("printed")) printed.classList.add("replaced");
    } catch (error) {
      // The printed figure is there; a chart that fails is not worth more than a line in the console.
      figure.hidden = true;
      console.error(error);
    }
  });
}
