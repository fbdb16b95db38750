"use strict";
// All numbers come from the module; what stands here asks for them and draws.

const COLOURS = { ink: "#1a1a1a", blue: "#0072b2", vermillion: "#d55e00", green: "#009e73",
  orange: "#e69f00", sky: "#56b4e9", grey: "#9aa1aa", line: "#e8ebef", soft: "#5c6470" };
const byId = (id) => document.getElementById(id);

const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const numbers = (text) => new Float64Array(bytes(text).buffer);
const shown = (x) => !Number.isFinite(x) ? "–" : x === 0 ? "0"
  : Math.abs(x) >= 1e5 || Math.abs(x) < 1e-3 ? x.toExponential(2) : x.toPrecision(4).replace(/^(\d{4})\.$/, "$1");

function element(parent, tag, attributes = {}, text = "") {
  const made = document.createElement(tag);
  Object.entries(attributes).forEach(([name, value]) => made.setAttribute(name, value));
  made.textContent = text;
  parent.append(made);
  return made;
}

// --- the module -------------------------------------------------------------------------------

class Core {
  constructor(exports) { this.to = exports; this.kept = new Map(); }
  view(at, count) { return new Float64Array(this.to.memory.buffer, at, count); }
  put(values) {
    const at = this.to.room(values.length);
    this.view(at, values.length).set(values);
    return at;
  }
  // room that is used again and again
  scratch(name, count) {
    const known = this.kept.get(name);
    if (known && known.count >= count) return known.at;
    if (known) this.to.give_back(known.at, known.count);
    const at = this.to.room(count);
    this.kept.set(name, { at, count });
    return at;
  }
  observer(text) {
    const values = numbers(text), at = this.put(values), made = this.to.observer(at, values.length);
    this.to.give_back(at, values.length);
    if (!made) throw new Error("the module does not read an observer of this page");
    return made;
  }
}

// The same number as in Python: whether all bits are the same.
function digest(values) {
  const bits = new BigUint64Array(values.buffer, values.byteOffset, values.length);
  let sum = 0n;
  for (let i = 0; i < bits.length; i += 1) sum = BigInt.asUintN(64, sum + bits[i] * BigInt(2 * i + 1));
  return sum.toString(16).padStart(16, "0");
}

class Live {
  constructor(core, log) {
    this.core = core;
    this.log = log;
    this.y = core.put(log.y);
    this.t = log.period === null ? core.put(log.t) : 0;
    this.u = log.u ? core.put(log.u) : 0;
  }
  ready(way, structure) {
    if (way.live) return;
    way.live = this.core.observer(way.numbers);
    way.one = this.core.observer(way.unit);
    way.start = this.core.put(numbers(way.memory));
    way.follows = this.core.put(numbers(way.lift));
    way.n = structure.n;
  }
  // estimates (N, n) and innovations (N,)
  run(structure, way, ell) {
    this.ready(way, structure);
    const { core, log } = this, count = log.samples;
    const x = core.scratch("x", count * way.n), e = core.scratch("e", count);
    const done = core.to.run(way.live, ell, count, this.t, log.period || 0, this.y,
      structure.inputs ? this.u : 0, way.start, x, e);
    // views anew at each use: memory that grows leaves the old ones empty
    return { done, at: e, get x() { return core.view(x, count * way.n); }, get e() { return core.view(e, count); } };
  }
  figures(structure, way, ell, cutoffs, dt = this.log.dt) {
    this.ready(way, structure);
    const n = way.n, out = this.core.scratch("figures", 2 + 3 * n);
    this.core.to.figures(way.one, ell, dt, way.follows, cutoffs ? 1 : 0, out);
    const of = this.core.view(out, 2 + 3 * n), part = (i) => Array.from(of.subarray(2 + i * n, 2 + (i + 1) * n));
    return { radius: of[0], decay: of[1], noise: part(0), model: part(1), cutoff: part(2) };
  }
  bode(way, ell, omega) {
    const count = omega.length, n = way.n, at = this.core.scratch("omega", count);
    this.core.view(at, count).set(omega);
    const out = this.core.scratch("bode", 2 * n * count);
    this.core.to.bode(way.one, ell, this.log.dt, at, count, out);
    return this.core.view(out, 2 * n * count);
  }
  decay(way, ell, samples) {
    const out = this.core.scratch("decay", samples * way.n);
    this.core.to.decay(way.one, ell, this.log.dt, samples, out);
    return this.core.view(out, samples * way.n);
  }
  density(at, count, length) {
    const out = this.core.scratch("density", length / 2 + 1);
    this.core.to.density(at, count, length, this.log.dt, out);
    return Array.from(this.core.view(out, length / 2 + 1));
  }
}

// --- drawing ----------------------------------------------------------------------------------

const LEFT = 62, RIGHT = 10, TOP = 8, BOTTOM = 34;

class Plot {
  constructor(parent, { title, height, wide, x, y, logX = false, logY = false }) {
    this.figure = element(parent, "figure", wide ? { class: "wide" } : {});
    this.caption = element(this.figure, "figcaption");
    this.canvas = element(this.figure, "canvas", { style: `height:${height}px`, role: "img" });
    Object.assign(this, { title, height, xName: x, yName: y, logX, logY });
  }
  // legend: [colour, text, class]
  head(legend, told = "") {
    const key = JSON.stringify([this.title, legend]);
    if (key !== this.key) {
      this.key = key;
      this.caption.textContent = "";
      element(this.caption, "b", {}, this.title);
      legend.forEach(([colour, text, kind]) =>
        element(this.caption, "i", { style: `--c:${colour}`, class: kind || "" }, text));
      this.told = element(this.caption, "span", { class: "told" });
    }
    this.told.textContent = told;
    this.canvas.setAttribute("aria-label", `${this.title} ${told}`);
  }
  begin(x0, x1, y0, y1) {
    const ratio = window.devicePixelRatio || 1, width = this.figure.clientWidth - 24;
    if (this.canvas.width !== Math.round(width * ratio) || this.ratio !== ratio) {
      this.canvas.width = Math.round(width * ratio);
      this.canvas.height = Math.round(this.height * ratio);
      this.ratio = ratio;
    }
    const c = this.c = this.canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.clearRect(0, 0, width, this.height);
    Object.assign(this, { x0, x1, y0, y1, width, w: width - LEFT - RIGHT, h: this.height - TOP - BOTTOM });
    this.ax = this.logX ? [Math.log(x0), this.w / Math.log(x1 / x0)] : [x0, this.w / (x1 - x0)];
    this.ay = this.logY ? [Math.log(y0), this.h / Math.log(y1 / y0)] : [y0, this.h / (y1 - y0)];
    c.font = "11px system-ui, -apple-system, 'Segoe UI', 'Liberation Sans', 'DejaVu Sans', sans-serif";
    c.lineWidth = 1;
    c.strokeStyle = COLOURS.line;
    c.fillStyle = COLOURS.soft;
    c.textAlign = "center";
    const xs = this.logX ? decades(x0, x1, this.w / 42) : ticks(x0, x1, this.w / 80);
    const ys = this.logY ? decades(y0, y1, this.h / 24) : ticks(y0, y1, this.h / 26);
    c.beginPath();
    xs.forEach(({ at }) => { const px = this.px(at); c.moveTo(px, TOP); c.lineTo(px, TOP + this.h); });
    ys.forEach(({ at }) => { const py = this.py(at); c.moveTo(LEFT, py); c.lineTo(LEFT + this.w, py); });
    c.stroke();
    xs.forEach(({ at, text }) => c.fillText(text, this.px(at), TOP + this.h + 14));
    c.textAlign = "right";
    ys.forEach(({ at, text }) => c.fillText(text, LEFT - 6, this.py(at) + 3.5));
    c.textAlign = "center";
    c.fillText(this.xName, LEFT + this.w / 2, this.height - 4);
    c.save();
    c.translate(11, TOP + this.h / 2);
    c.rotate(-Math.PI / 2);
    c.fillText(this.yName, 0, 0);
    c.restore();
    c.save();
    c.beginPath();
    c.rect(LEFT, TOP, this.w, this.h);
    c.clip();
  }
  end() {
    this.c.restore();
    this.c.strokeStyle = "#4d4d4d";
    this.c.lineWidth = 0.8;
    this.c.beginPath();
    this.c.moveTo(LEFT, TOP);
    this.c.lineTo(LEFT, TOP + this.h);
    this.c.lineTo(LEFT + this.w, TOP + this.h);
    this.c.stroke();
  }
  px(x) { return LEFT + ((this.logX ? Math.log(x) : x) - this.ax[0]) * this.ax[1]; }
  py(y) { return TOP + this.h - ((this.logY ? Math.log(y) : y) - this.ay[0]) * this.ay[1]; }
  line(xs, of, colour, width = 1.6, dash = []) {
    const c = this.c;
    c.strokeStyle = colour;
    c.lineWidth = width;
    c.lineJoin = "round";
    c.setLineDash(dash);
    c.beginPath();
    let pen = false;
    for (let i = 0; i < xs.length; i += 1) {
      const y = of(i);
      if (!Number.isFinite(y) || (this.logY && y <= 0)) { pen = false; continue; }
      if (pen) c.lineTo(this.px(xs[i]), this.py(y)); else c.moveTo(this.px(xs[i]), this.py(y));
      pen = true;
    }
    c.stroke();
    c.setLineDash([]);
  }
  upright(x, colour, dash = [4, 3]) {
    this.line([x, x], (i) => (i ? this.y1 : this.y0), colour, 1.2, dash);
  }
  dot(x, y, colour, size = 3.2) {
    if (!Number.isFinite(y) || (this.logY && y <= 0)) return;
    this.c.fillStyle = colour;
    this.c.beginPath();
    this.c.arc(this.px(x), this.py(y), size, 0, 7);
    this.c.fill();
  }
  // samples: one line for each column of pixels from the least to the largest; `spread` for a band
  samples(t, values, step, first, range, { colour, width = 1.3, spread = 0, points = false }) {
    const c = this.c, [from, to] = range, one = this.ax[1] / this.ratio < 0 ? 1 : 1 / this.ratio;
    const upper = [], lower = [];
    c.strokeStyle = c.fillStyle = colour;
    c.lineWidth = width;
    c.lineJoin = "bevel";
    const dense = (to - from) > 2 * this.w;
    c.beginPath();
    let column = NaN, low = 0, high = 0, last = 0, pen = false;
    const flush = () => {
      if (Number.isNaN(column)) return;
      const px = column * one;
      if (spread > 0) { upper.push(px, this.py(high + spread)); lower.push(px, this.py(low - spread)); return; }
      const a = this.py(low), b = this.py(high), z = this.py(last);
      if (points) { c.rect(px - 0.5, b, 1, Math.max(a - b, 1)); return; }
      if (pen) c.lineTo(px, a); else c.moveTo(px, a);
      if (a !== b) c.lineTo(px, b);
      if (z !== b) c.lineTo(px, z);
      pen = true;
    };
    for (let i = from; i < to; i += 1) {
      const value = values[i * step + first];
      if (value !== value) { if (!points) { flush(); column = NaN; pen = false; } continue; }
      const px = this.px(t[i]), here = dense ? Math.round(px / one) : px / one;
      if (!dense && points) {
        c.rect(px - 1.1, this.py(value) - 1.1, 2.2, 2.2);
      } else if (here === column) {
        if (value < low) low = value;
        if (value > high) high = value;
        last = value;
      } else {
        flush();
        column = here;
        low = high = last = value;
      }
    }
    flush();
    if (spread > 0) {
      for (let i = 0; i < upper.length; i += 2) c.lineTo(upper[i], upper[i + 1]);
      for (let i = lower.length - 2; i >= 0; i -= 2) c.lineTo(lower[i], lower[i + 1]);
      c.fill();
    } else if (points) c.fill(); else c.stroke();
  }
}

function ticks(low, high, most) {
  const rough = (high - low) / Math.max(most, 2), power = 10 ** Math.floor(Math.log10(rough));
  const part = [1, 2, 2.5, 5, 10].find((one) => one * power >= rough), step = part * power, out = [];
  const digits = Math.max(0, (part === 2.5 ? 1 : 0) - Math.floor(Math.log10(step) + 1e-9));
  const size = Math.max(Math.abs(low), Math.abs(high));
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k += 1) {
    const at = k * step;
    out.push({ at, text: size >= 1e5 || size < 1e-3 ? (at === 0 ? "0" : at.toExponential(1)) : at.toFixed(digits) });
  }
  return out;
}

function decades(low, high, most) {
  const from = Math.ceil(Math.log10(low) - 1e-9), to = Math.floor(Math.log10(high) + 1e-9), out = [];
  const every = Math.max(1, Math.ceil((to - from + 1) / Math.max(most, 1)));
  const finer = to - from < 2 ? [1, 2, 5] : [1];
  for (let k = from - 1; k <= to; k += every) {
    finer.forEach((part) => {
      const at = part * 10 ** k;
      if (at < low * 0.999 || at > high * 1.001) return;
      out.push({ at, text: k >= -2 && k <= 4 ? String(Number(at.toPrecision(3))) : `${part === 1 ? "" : part + "·"}10${raised(k)}` });
    });
  }
  return out;
}
const raised = (k) => String(k).replace(/./g, (c) => c === "-" ? "⁻" : "⁰¹²³⁴⁵⁶⁷⁸⁹"[c]);

function bounds(all, margin = 0.06) {
  let low = Infinity, high = -Infinity;
  all.forEach(([values, step, first, from, to]) => {
    for (let i = from; i < to; i += 1) {
      const value = values[i * step + first];
      if (value < low) low = value;
      if (value > high) high = value;
    }
  });
  if (!(low <= high)) return [-1, 1];
  const more = (high - low || Math.abs(high) || 1) * margin;
  return [low - more, high + more];
}

function geometric(low, high, count) {
  return Float64Array.from({ length: count }, (_, i) => low * (high / low) ** (i / (count - 1)));
}

// --- the page ---------------------------------------------------------------------------------

const STEPS = 1200; // of a logarithmic slider
const LONGEST = 4000; // samples of a decay that is drawn

class Page {
  constructor(core, data, version) {
    Object.assign(this, { core, data, version });
    const log = data.log;
    log.y = numbers(log.y);
    log.t = log.t === null ? Float64Array.from({ length: log.samples }, (_, k) => k * log.period) : numbers(log.t);
    log.u = log.u === null ? null : numbers(log.u);
    this.log = log;
    this.live = new Live(core, log);
    if (data.reference) {
      const { t, x, n, name } = data.reference;
      this.reference = { t: numbers(t), x: numbers(x), n, name };
      this.reference.rows = rows_of(this.reference.t, log.t);
    }
    this.range = [log.t[0], log.t[log.samples - 1]];
    this.curves = new Map();
    this.spectra = new Map();
    this.controls();
    this.plots();
    this.choose(this.data.structures.findIndex((of) => of.name === this.data.chosen));
    this.check();
    window.addEventListener("resize", () => this.ask());
  }

  get structure() { return this.data.structures[this.at]; }
  get way() { return this.structure.ways[this.by]; }

  controls() {
    const form = byId("controls");
    form.addEventListener("submit", (event) => event.preventDefault());
    const label = (text) => {
      const made = element(form, "label"), head = element(made, "span");
      element(head, "span", {}, text);
      return [made, head];
    };
    const select = (text, change) => {
      const [made] = label(text), box = element(made, "select", { "aria-label": text });
      box.addEventListener("change", () => change(Number(box.value)));
      return box;
    };
    const slider = (text, change) => {
      const [made, head] = label(text);
      const input = element(head, "input", { type: "text", inputmode: "decimal", "aria-label": text });
      const bar = element(made, "input", { type: "range", min: 0, max: STEPS, step: 1, "aria-label": `${text}, slider` });
      const of = { low: 1, high: 10, value: 1, bar, input, label: made };
      of.set = (value) => {
        of.value = value;
        bar.value = Math.round(STEPS * Math.log(value / of.low) / Math.log(of.high / of.low));
        input.value = Number(value.toPrecision(6));
      };
      bar.addEventListener("input", () => {
        of.value = of.low * (of.high / of.low) ** (bar.value / STEPS);
        input.value = Number(of.value.toPrecision(6));
        change(of.value);
      });
      input.addEventListener("change", () => {
        const value = Number(input.value);
        if (value > 0 && Number.isFinite(value)) { of.set(value); change(value); } else of.set(of.value);
      });
      return of;
    };
    this.box = select("Structure", (at) => this.choose(at));
    this.data.structures.forEach((of, at) => element(this.box, "option", { value: at }, of.name || "the observer"));
    this.boxOfWays = select("Method and timing", (by) => { this.by = by; this.ask(); });
    this.boxOfStates = select("Estimate that is drawn", (i) => { this.state = i; this.ask(); });
    this.gain = slider("Gain ℓ, 1/s", () => this.ask());
    this.noise = slider("Noise of a sample, σ", () => this.ask());
    this.lack = slider("Model error √Q", () => this.ask());
    const buttons = element(form, "div", { class: "buttons" });
    const press = (text, kind, done) =>
      element(buttons, "button", { type: "button", class: kind }, text).addEventListener("click", done);
    press("observer.toml", "main", () => this.save());
    press(this.data.criterion ? "Tuned values" : "As given", "", () => this.choose(this.data.structures.findIndex((of) => of.name === this.data.chosen)));
    press("Least error", "", () => this.least());
    this.table = element(form, "table");
    const more = element(form, "details");
    element(more, "summary", {}, "observer.toml of these values");
    this.text = element(more, "pre");
    const level = this.data.noise || this.least_innovation() || 1;
    this.known = this.data.noise !== null;
    [this.noise.low, this.noise.high] = [level / 100, level * 100];
    const lack = this.data.model_error || level;
    [this.lack.low, this.lack.high] = [lack / 1000, lack * 1000];
    this.levels = [level, lack];
  }

  least_innovation() {
    const all = this.data.structures.flatMap((of) => Array.from(numbers(of.curve.innovation))).filter(Number.isFinite);
    return all.length ? Math.min(...all) : 0;
  }

  plots() {
    const box = byId("plots"), time = "time, s";
    this.output = new Plot(box, { title: "Output", height: 190, wide: true, x: time, y: "y" });
    this.estimate = new Plot(box, { title: "Estimate", height: 270, wide: true, x: time, y: "" });
    if (this.reference) this.apart = new Plot(box, { title: "Difference", height: 150, wide: true, x: time, y: "" });
    this.trade = new Plot(box, { title: "Error over the gain", height: 250, x: "gain ℓ, 1/s", y: "standard deviation", logX: true, logY: true });
    this.response = new Plot(box, { title: "Bode, amplitude", height: 250, x: "frequency, Hz", y: "amplitude", logX: true, logY: true });
    this.spectrum = new Plot(box, { title: "Spectrum", height: 250, x: "frequency, Hz", y: "density, unit²/Hz", logX: true, logY: true });
    this.phase = new Plot(box, { title: "Bode, phase relative to the derivative", height: 250, x: "frequency, Hz", y: "phase, °", logX: true });
    this.wrong = new Plot(box, { title: "Peaking", height: 250, wide: true, x: time, y: "error" });
    [this.output, this.estimate, this.apart].filter(Boolean).forEach((plot) => this.movable(plot));
  }

  // wheel: closer or wider; drag: along; double click: all
  movable(plot) {
    const whole = [...this.range], { canvas } = plot;
    const at = (event) => {
      const px = event.clientX - canvas.getBoundingClientRect().left;
      return this.range[0] + (px - LEFT) / plot.w * (this.range[1] - this.range[0]);
    };
    const go = (low, high) => {
      const length = Math.min(Math.max(high - low, 5 * this.log.dt), whole[1] - whole[0]);
      const from = Math.min(Math.max(low, whole[0]), whole[1] - length);
      this.range = [from, from + length];
      this.ask();
    };
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      const here = at(event), by = Math.exp(0.0015 * event.deltaY);
      go(here + (this.range[0] - here) * by, here + (this.range[1] - here) * by);
    }, { passive: false });
    let held = null;
    canvas.addEventListener("pointerdown", (event) => { held = at(event); canvas.setPointerCapture(event.pointerId); });
    canvas.addEventListener("pointermove", (event) => {
      if (held === null) return;
      const by = held - at(event);
      go(this.range[0] + by, this.range[1] + by);
    });
    canvas.addEventListener("pointerup", () => { held = null; });
    canvas.addEventListener("dblclick", () => go(...whole));
  }

  choose(at) {
    this.at = Math.max(at, 0);
    this.by = 0;
    const of = this.structure;
    this.box.value = this.at;
    this.boxOfWays.textContent = "";
    of.ways.forEach((way, by) => element(this.boxOfWays, "option", { value: by }, `${way.method}, ${way.timing}`));
    this.state = Math.min(this.data.state, of.n) - 1;
    this.boxOfStates.textContent = "";
    of.states.forEach((name, i) => element(this.boxOfStates, "option", { value: i }, `${i + 1}: ${name}`));
    this.boxOfStates.value = this.state;
    [this.gain.low, this.gain.high] = of.range;
    this.gain.set(of.ell);
    this.noise.set(this.levels[0]);
    this.lack.set(this.levels[1]);
    this.ask();
  }

  // what the curves have their least total error at
  least() {
    const { ells, noise, model } = this.curve();
    const total = ells.map((_, k) => this.total(noise[k][this.state], model[k][this.state]));
    let best = 0;
    total.forEach((value, k) => { if (!(total[best] <= value)) best = k; });
    if (Number.isFinite(total[best])) { this.gain.set(ells[best]); this.ask(); }
  }

  save() {
    const link = element(document.body, "a", {
      href: URL.createObjectURL(new Blob([this.toml()], { type: "application/toml" })), download: "observer.toml" });
    link.click();
    URL.revokeObjectURL(link.href);
    link.remove();
  }

  toml() {
    const [before, own, after] = this.way.toml, ell = this.gain.value;
    const text = ell === this.structure.ell ? own : Number.isInteger(ell) && ell < 1e21 ? ell.toFixed(1) : String(ell);
    return before + text + after;
  }

  // whether the module has Python's bits, here and now
  check() {
    const of = this.structure, run = this.live.run(of, of.ways[0], of.ell);
    this.same = digest(run.x) === of.digest;
    byId("footer").textContent = "";
    const told = (text) => element(byId("footer"), "p", {}, text);
    told(this.same
      ? "The estimates that this page opens with have the same bits as Python's: checked now."
      : "Not the same bits as Python's: please report this browser as a fault of hgo_rs.");
    told("Bode, bands and peaking are computed for the law without its model, at the median step.");
    this.data.left.forEach((text) => told(`Left out: ${text}`));
    this.time = told("");
    this.time.id = "time";
  }

  ask() {
    if (this.asked) return;
    this.asked = true;
    requestAnimationFrame(() => { this.asked = false; if (!this.gone) this.draw(); });
  }

  curve() {
    const key = `${this.at} ${this.by}`;
    if (!this.curves.has(key)) {
      const [low, high] = this.structure.range, ells = Array.from(geometric(low, high, 60));
      const found = ells.map((ell) => this.live.figures(this.structure, this.way, ell, false));
      this.curves.set(key, { ells, noise: found.map((of) => of.noise), model: found.map((of) => of.model) });
    }
    return this.curves.get(key);
  }

  // standard deviations of estimate i: noise, model error
  parts(noise, model, i = this.state) {
    const units = this.structure.units, last = units[units.length - 1];
    return [this.noise.value * Math.sqrt(noise) / units[i], this.lack.value * Math.sqrt(model) * last / units[i]];
  }
  total(noise, model, i = this.state) { return Math.hypot(...this.parts(noise, model, i)); }

  draw() {
    const began = performance.now();
    const { structure, way, log, state } = this, ell = this.gain.value, n = structure.n;
    const run = this.live.run(structure, way, ell);
    const figures = this.live.figures(structure, way, ell, true);
    this.last = { run, figures };
    this.tell(run, figures, ell);
    const spread = this.total(figures.noise[state], figures.model[state]);
    this.drawTime(run, spread);
    this.drawTrade(figures, ell);
    const omega = geometric(1e-3 * Math.PI / log.dt, Math.PI / log.dt, 180);
    const stable = figures.radius < 1;
    this.drawBode(stable ? this.live.bode(way, ell, omega) : null, omega, figures);
    this.drawSpectrum(run);
    this.drawWrong(stable, figures, ell, n);
    this.tabulate(figures);
    this.text.textContent = this.toml();
    if (window.parent !== window) window.parent.postMessage({ observer: this.toml() }, "*");
    this.pictures = (this.pictures || 0) + 1;
    this.spent = performance.now() - began;
    if (this.time) this.time.textContent = `${log.samples} samples, ${this.spent.toFixed(1)} ms a picture. hgo_rs ${this.version}.`;
  }

  tell(run, figures, ell) {
    const { log, way } = this, said = [];
    if (run.done < 0) said.push("This gain is outside the range of the law.");
    else if (run.done < log.samples) said.push(`The estimate is not finite from t = ${shown(log.t[run.done])} s on.`);
    if (!(this.radius(ell) < 1)) {
      const most = this.limit(ell), to = most ? `holds up to ℓ = ${shown(most)} /s` : "does not hold";
      said.push(`Not stable: method ${way.method} ${to} at steps of ${shown(log.longest)} s, and run() refuses this gain. Lower it, or take method zoh.`);
    }
    const box = byId("notice");
    box.className = said.length ? "notice bad" : "notice";
    if (this.data.decimated) said.push(`Of this log: ${this.data.decimated}.`);
    box.hidden = !said.length;
    box.textContent = said.join(" ");
  }

  // of a step as long as the longest of the log
  radius(ell) { return this.live.figures(this.structure, this.way, ell, false, this.log.longest).radius; }

  // the largest stable gain below one that is not
  limit(ell) {
    let [low, high] = [ell * 1e-6, ell];
    if (!(this.radius(low) < 1)) return 0;
    while (high > low * 1.0001) {
      const middle = Math.sqrt(low * high);
      if (this.radius(middle) < 1) low = middle; else high = middle;
    }
    return low;
  }

  drawTime(run, spread) {
    const { log, structure, state } = this, n = structure.n, [low, high] = this.range;
    const place = (t, x) => { let a = 0, b = t.length; while (a < b) { const m = (a + b) >> 1; if (t[m] < x) a = m + 1; else b = m; } return a; };
    const done = Math.max(run.done, 0);
    const from = Math.max(place(log.t, low) - 1, 0), to = Math.min(place(log.t, high) + 1, log.samples);
    const end = Math.min(to, done), some = [from, end];
    const y = this.output;
    y.head([[COLOURS.grey, "samples", "dots"], [COLOURS.blue, `estimate of ${structure.states[0]}`]],
      `RMS innovation ${shown(rms(run.e, done))}`);
    y.begin(low, high, ...bounds([[log.y, 1, 0, from, to]]));
    y.samples(log.t, log.y, 1, 0, [from, to], { colour: COLOURS.grey, points: true });
    y.samples(log.t, run.x, n, 0, some, { colour: COLOURS.blue });
    y.end();
    const plot = this.estimate, legend = [[COLOURS.blue, structure.states[state]]];
    const smooth = this.reference && state < this.reference.n ? this.reference : null;
    const band = Number.isFinite(spread) && spread > 0;
    if (band) legend.push(["#cfe3f1", "± 2 predicted standard deviations", "band"]);
    if (smooth) legend.push([COLOURS.vermillion, smooth.name, "dashed"]);
    plot.yName = structure.states[state];
    plot.head(legend, band ? `predicted error ${shown(spread)}` : "");
    const all = [[run.x, n, state, from, end]];
    let part = [0, 0];
    if (smooth) {
      part = [Math.max(place(smooth.t, low) - 1, 0), Math.min(place(smooth.t, high) + 1, smooth.t.length)];
      all.push([smooth.x, smooth.n, state, ...part]);
    }
    // the start may peak: what is drawn is scaled by what follows
    const skip = Math.min(from + Math.round(0.02 * log.samples), end);
    if (low <= log.t[0] && end - skip > 10 && !this.data.truth) all[0] = [run.x, n, state, skip, end];
    plot.begin(low, high, ...bounds(all, 0.1));
    if (band) plot.samples(log.t, run.x, n, state, some, { colour: "#cfe3f1", spread: 2 * spread });
    plot.samples(log.t, run.x, n, state, some, { colour: COLOURS.blue });
    if (smooth) {
      plot.c.setLineDash([5, 3]);
      plot.samples(smooth.t, smooth.x, smooth.n, state, part, { colour: COLOURS.vermillion, width: 1.1 });
      plot.c.setLineDash([]);
    }
    plot.end();
    if (this.apart) this.drawApart(run, smooth, part, done, band ? spread : 0);
  }

  drawApart(run, smooth, [from, to], done, spread) {
    const { structure, state, apart: plot } = this, n = structure.n, name = structure.states[state];
    const [low, high] = this.range;
    if (!smooth) {
      plot.head([[COLOURS.grey, `no reference for ${name}`]], "");
      plot.begin(low, high, -1, 1);
      plot.end();
      return;
    }
    const { x } = run;
    if (!this.off || this.off.length !== smooth.t.length) this.off = new Float64Array(smooth.t.length);
    let sum = 0, count = 0;
    for (let i = 0; i < smooth.t.length; i += 1) {
      const k = smooth.rows[i], off = k < 0 || k >= done ? NaN : x[k * n + state] - smooth.x[i * smooth.n + state];
      this.off[i] = off;
      if (i >= smooth.t.length / 20 && off === off) { sum += off * off; count += 1; }
    }
    const found = Math.sqrt(sum / Math.max(count, 1)), top = 3.2 * Math.max(found, spread) || 1;
    this.last.apart = found;
    plot.yName = `${name} − ${this.data.truth ? "truth" : "smoothed"}`;
    const legend = [[COLOURS.blue, `estimate of ${name} minus its ${this.data.truth ? "true" : "smoothed"} value`]];
    if (spread) legend.push(["#cfe3f1", "± 2 predicted standard deviations", "band"]);
    plot.head(legend, `RMS ${shown(found)} after the first twentieth`);
    plot.begin(low, high, -top, top);
    if (spread) {
      plot.c.fillStyle = "#cfe3f1";
      plot.c.fillRect(LEFT, plot.py(2 * spread), plot.w, plot.py(-2 * spread) - plot.py(2 * spread));
    }
    plot.line([low, high], () => 0, COLOURS.grey, 1);
    plot.samples(smooth.t, this.off, 1, 0, [from, to], { colour: COLOURS.blue, width: 1 });
    plot.end();
  }

  drawTrade(figures, ell) {
    const { structure, state } = this, { ells, noise, model } = this.curve(), plot = this.trade;
    const parts = ells.map((_, k) => this.parts(noise[k][state], model[k][state]));
    const total = parts.map((both) => Math.hypot(...both));
    const legend = [[COLOURS.ink, "error"], [COLOURS.orange, "from noise"], [COLOURS.sky, "from model error"]];
    const own = this.by === 0 && state + 1 === this.data.state;
    const tuned = numbers(structure.curve.ell), measured = numbers(structure.curve.measured);
    const known = own && measured.some(Number.isFinite);
    if (known) legend.push([COLOURS.green, "measured on the log", "dots"]);
    const now = this.total(figures.noise[state], figures.model[state]);
    plot.head(legend, Number.isFinite(now) ? `at ℓ: ${shown(now)}` : "");
    const values = [...total, ...(known ? measured : [])].filter((value) => value > 0 && Number.isFinite(value));
    const low = values.length ? Math.min(...values) : 0.1;
    const high = values.length ? Math.min(Math.max(...values), 1e4 * low) : 1;
    plot.begin(...structure.range, 0.15 * low, 1.5 * high);
    plot.line(ells, (k) => parts[k][0], COLOURS.orange);
    plot.line(ells, (k) => parts[k][1], COLOURS.sky);
    plot.line(ells, (k) => total[k], COLOURS.ink, 2);
    if (known) tuned.forEach((at, k) => plot.dot(at, measured[k], COLOURS.green, 2.4));
    plot.upright(structure.ell, COLOURS.grey, [2, 3]);
    plot.upright(ell, COLOURS.vermillion);
    plot.dot(ell, now, COLOURS.vermillion, 4);
    plot.end();
  }

  drawBode(found, omega, figures) {
    const { structure, state } = this, n = structure.n, hz = omega.map((w) => w / (2 * Math.PI));
    const size = (k) => found ? Math.hypot(found[2 * (k * n + state)], found[2 * (k * n + state) + 1]) : NaN;
    const ideal = (k) => omega[k] ** state;
    const cutoff = figures.cutoff[state] / (2 * Math.PI);
    const plot = this.response;
    plot.head([[COLOURS.blue, `${structure.states[state]} / y`], [COLOURS.grey, state ? "derivative" : "1", "dashed"]],
      Number.isFinite(cutoff) ? `cutoff ${shown(cutoff)} Hz` : "no cutoff");
    const all = Array.from(omega, (_, k) => size(k)).filter((value) => value > 0 && Number.isFinite(value));
    const top = Math.max(...all, ideal(0)), low = Math.min(...all, top);
    plot.begin(hz[0], hz[hz.length - 1], Math.max(0.5 * low, 1e-7 * top), 3 * top);
    plot.line(hz, ideal, COLOURS.grey, 1.2, [5, 4]);
    plot.line(hz, size, COLOURS.blue, 2);
    if (Number.isFinite(cutoff)) plot.upright(cutoff, COLOURS.vermillion);
    plot.end();
    const turn = this.phase;
    turn.head([[COLOURS.blue, structure.states[state]]], "");
    let before = 0;
    const angles = Array.from(omega, (_, k) => {
      if (!found) return NaN;
      let angle = Math.atan2(found[2 * (k * n + state) + 1], found[2 * (k * n + state)]) * 180 / Math.PI - 90 * state;
      angle -= 360 * Math.round((angle - before) / 360);
      before = angle;
      return angle;
    });
    turn.begin(hz[0], hz[hz.length - 1], Math.min(-90, ...angles.filter(Number.isFinite)) - 10, Math.max(10, ...angles.filter(Number.isFinite)) + 5);
    turn.line(hz, (k) => angles[k], COLOURS.blue, 2);
    if (Number.isFinite(cutoff)) turn.upright(cutoff, COLOURS.vermillion);
    turn.end();
  }

  drawSpectrum(run) {
    const { log } = this, done = Math.max(run.done, 0);
    const length = 2 ** Math.min(Math.floor(Math.log2(Math.max(log.samples / 4, 16))), 11);
    if (!this.spectra.has(length)) this.spectra.set(length, this.live.density(this.live.y, log.samples, length));
    const y = this.spectra.get(length);
    const e = done === log.samples ? this.live.density(run.at, log.samples, length) : [];
    const hz = Float64Array.from({ length: length / 2 }, (_, k) => (k + 1) / (length * log.dt));
    const level = 2 * this.noise.value ** 2 * log.dt;
    const plot = this.spectrum;
    plot.head([[COLOURS.grey, "y"], [COLOURS.green, "innovation"], [COLOURS.orange, "noise", "dashed"]], "");
    const all = [...y.slice(1), ...e.slice(1), level].filter((value) => value > 0 && Number.isFinite(value));
    const top = Math.max(...all), low = Math.max(Math.min(...all), 1e-12 * top);
    plot.begin(hz[0], hz[hz.length - 1], 0.5 * low, 2 * top);
    plot.line(hz, (k) => y[k + 1], COLOURS.grey, 1.2);
    plot.line(hz, (k) => e[k + 1], COLOURS.green, 1.5);
    plot.line([hz[0], hz[hz.length - 1]], () => level, COLOURS.orange, 1.5, [5, 4]);
    plot.end();
  }

  drawWrong(stable, figures, ell, n) {
    const { structure, state, way, log } = this, plot = this.wrong;
    if (!stable) {
      plot.head([[COLOURS.blue, "no decay"]], "");
      plot.begin(0, 1, -1, 1);
      plot.end();
      return;
    }
    const whole = Math.min(Math.max(figures.decay, 4), LONGEST), errors = this.live.decay(way, ell, whole);
    let peak = 0;
    for (let k = 0; k < whole; k += 1) peak = Math.max(peak, Math.abs(errors[k * n + state]));
    let settled = 0;
    for (let k = 0; k < whole; k += 1) if (Math.abs(errors[k * n + state]) > 0.02 * peak) settled = k + 1;
    this.last.peak = peak;
    this.last.settled = settled * log.dt;
    const count = Math.min(whole, Math.max(Math.ceil(1.4 * settled), 4));
    const t = Float64Array.from({ length: count }, (_, k) => k * log.dt);
    plot.yName = `error of ${structure.states[state]}`;
    plot.head([[COLOURS.blue, `error of ${structure.states[state]} after a start with ${structure.states[0]} wrong by 1`]],
      `peak ${shown(peak)}, settled (2 %) after ${shown(settled * log.dt)} s`);
    plot.begin(0, t[count - 1], ...bounds([[errors, n, state, 0, count], [[0], 1, 0, 0, 1]], 0.08));
    plot.line([0, t[count - 1]], () => 0, COLOURS.grey, 1);
    plot.line(t, (k) => errors[k * n + state], COLOURS.blue, 2);
    if (count < 60) t.forEach((at, k) => plot.dot(at, errors[k * n + state], COLOURS.blue, 2.4));
    plot.upright(settled * log.dt, COLOURS.vermillion);
    plot.end();
  }

  // RMS error of estimate i after the first tenth of the record
  missed(truth, i) {
    const { x } = this.last.run, n = this.structure.n, count = this.log.samples;
    return rms_of((k) => x[k * n + i] - truth.x[k * truth.n + i], Math.floor(count / 10), count);
  }

  tabulate(figures) {
    const { table, structure } = this, n = structure.n;
    const rows = structure.states.map((name, i) => {
      const [noise, model] = this.parts(figures.noise[i], figures.model[i], i);
      return [name, shown(noise), shown(model), shown(Math.hypot(noise, model)), shown(figures.cutoff[i] / (2 * Math.PI))];
    });
    const truth = this.data.truth && this.reference;
    if (truth) rows.forEach((row, i) => row.push(i < truth.n ? shown(this.missed(truth, i)) : "–"));
    const key = `${this.at}`;
    if (this.rows !== key) {
      this.rows = key;
      table.textContent = "";
      const head = element(table, "tr");
      ["", "noise", "model", "error", "cutoff Hz", ...(truth ? ["RMS, true"] : [])].forEach((text) => element(head, "th", {}, text));
      this.cells = rows.map((row) => { const made = element(table, "tr"); return row.map(() => element(made, "td")); });
    }
    rows.forEach((row, i) => {
      this.cells[i][0].parentNode.className = i === this.state ? "wanted" : "";
      row.forEach((text, j) => { this.cells[i][j].textContent = text; });
    });
  }
}

// the sample of the same time for each time, -1 where there is none
function rows_of(times, t) {
  let k = 0;
  return Int32Array.from(times, (time) => {
    while (k < t.length && t[k] < time) k += 1;
    return t[k] === time ? k : -1;
  });
}

function rms_of(at, from, to) {
  let sum = 0;
  for (let k = from; k < to; k += 1) sum += at(k) ** 2;
  return Math.sqrt(sum / Math.max(to - from, 1));
}

function rms(values, count) {
  let sum = 0, there = 0;
  for (let i = 0; i < count; i += 1) if (Number.isFinite(values[i])) { sum += values[i] ** 2; there += 1; }
  return Math.sqrt(sum / Math.max(there, 1));
}

function refuse(text) {
  const box = byId("notice");
  box.hidden = false;
  box.className = "notice bad";
  box.textContent = text;
}

function about(system) {
  const tuned = system.structures.find((of) => of.name === system.chosen) || system.structures[0];
  if (!system.criterion) return system.text;
  const chosen = `gain ${shown(tuned.ell)} /s by ${system.criterion} of ${tuned.states[system.state - 1]}`;
  return [system.text, system.chosen, chosen,
    system.judged_by && `compared with the smoothed state by ${system.judged_by}`, ...system.warnings].filter(Boolean).join(" · ");
}

async function open() {
  const { systems, version } = JSON.parse(byId("data").textContent), first = systems[0];
  byId("about").textContent = about(first);
  if (typeof WebAssembly !== "object") {
    const tuned = first.structures.find((of) => of.name === first.chosen) || first.structures[0];
    refuse("This page needs WebAssembly, and this browser has none: open it in a current Firefox, Chrome, " +
      `Edge or Safari. The tuned gain is ${tuned.ell} /s (${first.chosen}).`);
    return;
  }
  try {
    const { instance } = await WebAssembly.instantiate(bytes(JSON.parse(byId("module").textContent)), {});
    const core = new Core(instance.exports);
    const show = (at) => {
      ["controls", "plots", "footer"].forEach((id) => { byId(id).textContent = ""; });
      byId("about").textContent = about(systems[at]);
      if (window.hgo) window.hgo.gone = true;
      window.hgo = new Page(core, structuredClone(systems[at]), version);
    };
    const tabs = byId("systems");
    tabs.hidden = systems.length < 2;
    systems.forEach((system, at) => {
      const tab = element(tabs, "button", { type: "button", "aria-pressed": at === 0 }, system.title);
      tab.addEventListener("click", () => {
        tabs.querySelectorAll("button").forEach((other) => other.setAttribute("aria-pressed", other === tab));
        show(at);
      });
    });
    show(0);
  } catch (error) {
    refuse(`This page cannot compute here: ${error.message}. Open it in a current browser.`);
    throw error;
  }
}
open();
