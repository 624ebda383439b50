// Charts, drawn by uPlot: axes, crosshair and the marked rectangle are its own. Loops are not functions of their
// abscissa, so that curves, values at the pointer and zoom are drawn and found here, in SI units until they are shown.

const OVERLAYS = 8, WHEEL_STEP = 1.25, CLOSEST_ZOOM = 1e-4, POINTER_PX = 40, NEAR_PX = 8;
const pointer_ms = []; // from an event of the pointer to its values on the screen

let colours = new Map(); // read some hundred times per second; discarded when the theme changes
function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}
function rem() { return parseFloat(getComputedStyle(document.documentElement).fontSize); }

function number(value) {
  if (!isFinite(value)) return "–";
  const size = Math.abs(value);
  return value.toFixed(size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3).replace(/^-(0\.?0*)$/, "$1");
}
function plain(value) { return isFinite(value) ? String(Number(value.toPrecision(4))) : "–"; }

// What people read: SI values with the unit and the sign of the display.
const QUANTITIES = {
  force: { unit: "N", scale: 1, offset: 0, sign: 1 }, displacement: { unit: "mm", scale: 1e-3, offset: 0, sign: 1 },
  speed: { unit: "m/s", scale: 1, offset: 0, sign: 1 }, temperature: { unit: "degC", scale: 1, offset: 0, sign: 1 },
  current: { unit: "A", scale: 1, offset: 0, sign: 1 }, pressure: { unit: "bar", scale: 1e5, offset: 0, sign: 1 },
};
function shown(quantity, si) { const { scale, offset, sign } = QUANTITIES[quantity]; return sign * (si - offset) / scale; }
function magnitude(quantity, si) { const { scale, offset } = QUANTITIES[quantity]; return (si - offset) / scale; }
function peak_text(si) { // as many places in every row
  return shown("force", si).toFixed(Math.min(3, Math.max(0, Math.round(Math.log10(QUANTITIES.force.scale))))).replace(/^-(0\.?0*)$/, "$1");
}
function with_unit(quantity, si) { return `${number(shown(quantity, si))} ${QUANTITIES[quantity].unit}`; }
function with_unit_of(name, quantity) { const { unit } = QUANTITIES[quantity]; return unit ? `${name} (${unit})` : name; }
function shown_range(quantity, [low, high]) { return [shown(quantity, low), shown(quantity, high)].sort((a, b) => a - b); }

// An axis that follows its data without jumping: it grows at once, and shrinks only where the data need about half of it.
class Range {
  constructor() { this.low = NaN; this.high = NaN; }
  follow(low, high, least, may_shrink = true) {
    if (!(low <= high) || !isFinite(high - low)) { low = 0; high = 0; } // nothing measured
    const known = this.high > this.low;
    if (!known && high === low && !(least > 0)) return [-1, 1];
    if (known && !may_shrink) least = 0;
    const middle = (low + high) / 2, half = Math.max((high - low) / 2, least, 1e-9 * Math.abs(middle), 1e-12);
    let [bottom, top] = [middle - 1.08 * half, middle + 1.08 * half];
    if (Math.abs(middle) < 0.3 * half) { top = Math.max(-bottom, top); bottom = -top; } // about zero
    const fits = low >= this.low && high <= this.high && this.high - this.low >= 1.99 * least;
    if (fits && (!may_shrink || top - bottom > 0.55 * (this.high - this.low))) return [this.low, this.high];
    if (!may_shrink && known) { bottom = Math.min(bottom, this.low); top = Math.max(top, this.high); }
    [this.low, this.high] = [bottom, top];
    return [bottom, top];
  }
}

class Plot {
  // options: id of the canvas, x and y { label, values, splits, show, size }, lines [{ colour, width, dash, path }],
  // limits() [x low, x high, y low, y high], values(x, y) text at the pointer, zoomed(), sync
  constructor(box, options) {
    Object.assign(this, { box, options, view: null, lines: options.lines.map(() => [[], []]), range: { x: [0, 1], y: [0, 1] } });
    this.tip = element("output", "", "tip"); this.mark = element("div", undefined, "nearest");
    this.pointers = new Map(); this.pinched = null;
    this.box.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => { if (!this.plot || this.plot.width !== this.box.clientWidth || this.plot.height !== this.box.clientHeight) this.build(); }).observe(box);
  }
  build() { // anew for every size: fonts and margins follow the page's
    const { box, options } = this, size = rem(), font = `${(0.75 * size).toFixed(1)}px system-ui, sans-serif`;
    if (this.plot) this.plot.destroy();
    if (!box.clientWidth || !box.clientHeight) { this.plot = null; return; }
    const axis = (side, one, least, room) => ({
      side, show: one.show !== false, stroke: () => colour("--text"), font, labelFont: font, label: one.label, labelSize: one.label ? 1.1 * size : 0, labelGap: 0,
      gap: 0.3 * size, size: room, space: least, ticks: { show: false }, grid: { stroke: () => colour("--line"), width: 1 },
      values: one.values || ((plot, splits) => splits.map((split) => split === null ? "" : plain(split))), ...(one.splits ? { splits: one.splits } : {}),
    });
    const facets = [{ scale: "x", auto: false }, { scale: "y", auto: false }], range = (plot, low, high) => [low, high];
    this.plot = new uPlot({
      mode: 2, width: box.clientWidth, height: box.clientHeight, legend: { show: false }, padding: [0.4 * size, 0.7 * size, 0, 0],
      scales: { x: { time: false, auto: false, range }, y: { auto: false, range } },
      axes: [axis(2, options.x, 3.2 * size, 1.35 * size), axis(3, options.y, 1.9 * size, (options.y.size || 3) * size)],
      series: [null, ...options.lines.map((line, index) => ({
        facets, stroke: () => colour(line.colour), width: (line.width || 1.8) * size / 16, dash: line.dash ? line.dash.map((part) => part * size) : undefined,
        points: { show: false }, paths: (plot, series) => this.path(plot, index),
      }))],
      cursor: {
        y: !options.x_only,
        points: { show: false }, dataIdx: () => null, drag: { x: true, y: !options.x_only, setScale: false, dist: 5, uni: options.x_only ? null : 20 },
        bind: { dblclick: () => () => this.reset() }, ...(options.sync ? { sync: { key: options.sync, setSeries: false, scales: ["x", null] } } : {}),
      },
      hooks: { drawClear: [() => this.bands()], setCursor: [() => this.point_at()], setSelect: [() => this.selected()], draw: [() => { if (options.after) options.after(this); }] },
    }, [null, ...this.lines], box);
    this.plot.ctx.canvas.id = options.id;
    this.plot.over.append(this.tip, this.mark);
    this.listen(this.plot.over);
    this.show();
  }
  listen(over) {
    over.addEventListener("wheel", (event) => {
      if (!event.deltaY || (event.deltaY > 0 && !this.view)) return; // nothing to zoom out of: the page scrolls
      event.preventDefault();
      const at = over.getBoundingClientRect();
      this.zoom(event.deltaY < 0 ? 1 / WHEEL_STEP : WHEEL_STEP, event.clientX - at.left, event.clientY - at.top);
    }, { passive: false });
    over.addEventListener("mouseleave", () => this.hide_values());
    if (this.options.pressed) over.addEventListener("click", () => this.options.pressed(this));
    for (const kind of ["pointerdown", "pointermove", "pointerup", "pointercancel"]) over.addEventListener(kind, (event) => { if (event.pointerType === "touch") this.touch(kind, event); });
  }
  touch(kind, event) { // one finger: values; two: zoom
    const at = this.plot.over.getBoundingClientRect(), left = event.clientX - at.left, top = event.clientY - at.top;
    if (kind === "pointerup" || kind === "pointercancel") { this.pointers.delete(event.pointerId); this.pinched = null; return; }
    this.pointers.set(event.pointerId, { left, top });
    const [one, two] = [...this.pointers.values()];
    if (!two) { this.moved = event.timeStamp; this.plot.setCursor({ left, top }); return; }
    const apart = Math.max(10, Math.hypot(one.left - two.left, one.top - two.top));
    if (this.pinched) this.zoom(this.pinched / apart, (one.left + two.left) / 2, (one.top + two.top) / 2);
    this.pinched = apart;
  }
  key(event) {
    const plot = this.plot; if (!plot || event.ctrlKey || event.altKey || event.metaKey) return;
    const { clientWidth: width, clientHeight: height } = plot.over, middle = plot.cursor.left < 0;
    const left = middle ? width / 2 : plot.cursor.left, top = middle ? height / 2 : plot.cursor.top, step = event.shiftKey ? 1 : 0.02 * width;
    const steps = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (steps) { this.moved = event.timeStamp; plot.setCursor({ left: Math.min(width, Math.max(0, left + steps[0])), top: Math.min(height, Math.max(0, top + steps[1])) }); }
    else if (event.key === "+" || event.key === "=") this.zoom(1 / WHEEL_STEP, left, top);
    else if (event.key === "-") this.zoom(WHEEL_STEP, left, top);
    else if (event.key === "0") this.reset();
    else if (event.key === "Escape") this.hide_values();
    else return;
    event.preventDefault();
  }
  hide_values() { if (this.plot) this.plot.setCursor({ left: -10, top: -10 }); }
  zoom(by, left, top) {
    const about = (range, share) => { const at = range[0] + share * (range[1] - range[0]); return [at - by * (at - range[0]), at + by * (range[1] - at)]; };
    const { clientWidth: width, clientHeight: height } = this.plot.over, now = this.shown_range();
    const x = about(now.x, left / width), y = this.options.x_only ? now.y : about(now.y, 1 - top / height), whole = this.range;
    if (x[1] - x[0] < CLOSEST_ZOOM * (whole.x[1] - whole.x[0])) return;
    if (x[1] - x[0] >= whole.x[1] - whole.x[0]) this.reset(); else this.look_at({ x, y });
  }
  shown_range() { return this.view || this.range; }
  look_at(view) { this.view = view; if (this.options.zoomed) this.options.zoomed(this); this.show(); }
  reset() { this.look_at(null); }
  selected() {
    const { left, top, width, height } = this.plot.select, over = this.plot.over;
    if (width < 2 && height < 2) return;
    const { x, y } = this.shown_range(), along = (range, from, to) => [range[0] + from * (range[1] - range[0]), range[0] + to * (range[1] - range[0])];
    this.plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
    this.dragged = performance.now();
    this.look_at({
      x: width < 2 ? x : along(x, left / over.clientWidth, (left + width) / over.clientWidth),
      y: this.options.x_only || height < 2 ? y : along(y, 1 - (top + height) / over.clientHeight, 1 - top / over.clientHeight),
    });
  }
  draw(lines, range) { this.lines = lines; this.range = range; this.show(); }
  show() {
    const plot = this.plot; if (!plot) return;
    const { x, y } = this.shown_range();
    plot.batch(() => {
      plot.setData([null, ...this.lines], false);
      plot.setScale("x", { min: x[0], max: x[1] }); plot.setScale("y", { min: y[0], max: y[1] });
    });
    if (plot.cursor.left >= 0) this.point_at();
  }
  get scaled() { // what brings SI values to the canvas
    const { left, top, width, height } = this.plot.bbox, { x, y } = this.shown_range(), { quantities } = this.options;
    const across = width / (x[1] - x[0]), up = height / (y[1] - y[0]), at_x = shown(quantities[0], 0), at_y = shown(quantities[1], 0);
    const by_x = across * (shown(quantities[0], 1) - at_x), by_y = up * (shown(quantities[1], 1) - at_y); // straight lines: some 100,000 values per frame
    const from_x = left + across * (at_x - x[0]), from_y = top + up * (y[1] - at_y);
    return { px: (value) => from_x + by_x * value, py: (value) => from_y - by_y * value };
  }
  path(plot, index) {
    const stroke = new Path2D(), [xs, ys] = this.lines[index], { px, py } = this.scaled, { path } = this.options.lines[index];
    if (path) path(stroke, xs, ys, px, py);
    else for (let i = 0; i < xs.length; i++) if (i) stroke.lineTo(px(xs[i]), py(ys[i])); else stroke.moveTo(px(xs[i]), py(ys[i]));
    return { stroke, fill: null, clip: null, band: null, gaps: null, flags: 2 };
  }
  bands() {
    const { ctx: pen, bbox: { left, top, width, height } } = this.plot, { x, y } = this.shown_range(), limits = this.options.limits ? this.options.limits() : [];
    const across = (value) => left + width * Math.min(1, Math.max(0, (value - x[0]) / (x[1] - x[0]))), up = (value) => top + height * Math.min(1, Math.max(0, (y[1] - value) / (y[1] - y[0])));
    pen.save(); pen.fillStyle = colour("--band");
    if (isFinite(limits[0])) pen.fillRect(left, top, across(limits[0]) - left, height);
    if (isFinite(limits[1])) pen.fillRect(across(limits[1]), top, left + width - across(limits[1]), height);
    if (isFinite(limits[2])) pen.fillRect(left, up(limits[2]), width, top + height - up(limits[2]));
    if (isFinite(limits[3])) pen.fillRect(left, top, width, up(limits[3]) - top);
    pen.restore();
  }
  point_at() { // values at the pointer
    const { plot, tip, mark } = this, { left, top, event } = plot.cursor;
    const ratio = plot.bbox.width / plot.over.clientWidth, found = left < 0 ? null : this.options.values(this, left, top, ratio);
    tip.hidden = !found || this.options.silent; mark.hidden = !found || found.left === undefined;
    if (!found) return;
    if (tip.textContent !== found.text) tip.textContent = found.text;
    if (!tip.hidden) {
      const gap = 0.9 * rem(), wide = tip.offsetWidth, right = left + gap + wide <= plot.over.clientWidth;
      tip.style.left = `${right ? left + gap : Math.max(-plot.bbox.left / ratio, left - gap - wide)}px`;
      tip.style.top = `${Math.min(top + gap, Math.max(0, plot.over.clientHeight - tip.offsetHeight))}px`;
    }
    if (!mark.hidden) mark.style.transform = `translate(${found.left}px, ${found.top}px)`;
    const since = this.moved || (event ? event.timeStamp : 0);
    if (since && since !== this.measured) { this.measured = since; pointer_ms.push(performance.now() - since); if (pointer_ms.length > 2000) pointer_ms.shift(); }
    this.moved = 0;
  }
  // The point of the lines that is nearest to the pointer: { line, index, left, top }, in pixels of the page.
  nearest(left, top, ratio) {
    const { px, py } = this.scaled, { left: begin, top: above } = this.plot.bbox, x = begin + left * ratio, y = above + top * ratio;
    let best = null, least = (POINTER_PX * ratio) ** 2;
    this.lines.forEach(([xs, ys], line) => {
      for (let index = 0; index < xs.length; index++) {
        const across = px(xs[index]), up = py(ys[index]), far = (across - x) ** 2 + (up - y) ** 2;
        if (far < least) { least = far; best = { line, index, left: (across - begin) / ratio, top: (up - above) / ratio }; }
      }
    });
    return best;
  }
}

// Thousands of samples on some hundred pixel columns: draw the first, extreme and last value of each column. A command is `held` until the next one.
function draw_by_columns(pen, times, values, px, py, held) {
  let column = NaN, x = 0, first = 0, low = 0, high = 0, last = 0, on = false;
  // Nothing is drawn across the time in which this browser was not connected.
  const gap_s = times.length > 1 ? Math.max(0.5, 10 * (times[times.length - 1] - times[0]) / (times.length - 1)) : Infinity;
  const put = (y) => { if (on) pen.lineTo(x, y); else pen.moveTo(x, y); on = true; };
  const flush = () => {
    put(first);
    if (low < Math.min(first, last)) put(low);
    if (high > Math.max(first, last)) put(high);
    if (last !== first) put(last);
  };
  for (let i = 0; i < times.length; i++) {
    const at = px(times[i]), y = py(values[i]);
    if (i && times[i] - times[i - 1] > gap_s) { flush(); column = NaN; on = false; }
    if (Math.floor(at) === column) { low = Math.min(low, y); high = Math.max(high, y); last = y; continue; }
    if (!isNaN(column)) { flush(); if (held) pen.lineTo(at, last); }
    column = Math.floor(at); x = at; first = low = high = last = y;
  }
  if (!isNaN(column)) flush();
}
function draw_with_dots(pen, xs, ys, px, py) {
  const radius = (xs.length > 100 ? 0 : 0.2 * rem()) * (window.devicePixelRatio || 1);
  let on = false;
  for (let i = 0; i < xs.length; i++) {
    if (!isFinite(ys[i])) { on = false; continue; }
    const x = px(xs[i]), y = py(ys[i]);
    if (on) pen.lineTo(x, y);
    pen.moveTo(x + radius, y); pen.arc(x, y, radius, 0, 7); pen.moveTo(x, y); on = true;
  }
}
function draw_crosses(pen, xs, ys, px, py) {
  const half = 0.25 * rem() * (window.devicePixelRatio || 1);
  for (let i = 0; i < xs.length; i++) for (const slope of [1, -1]) { const x = px(xs[i]), y = py(ys[i]); pen.moveTo(x - half, y - slope * half); pen.lineTo(x + half, y + slope * half); }
}

// Force over displacement or velocity: two lines of the running motion, then one for each recorded point that is shown.
class LoopChart {
  constructor(box, id, x_channel, quantity, name) {
    Object.assign(this, { x_channel, quantity, name, x_range: new Range(), y_range: new Range(), names: [], limits: null, dot: null });
    const lines = [{ colour: "--before", width: 1.5 }, { colour: "--now", width: 2.4 }];
    for (let index = 1; index <= OVERLAYS; index++) lines.push({ colour: `--overlay-${index}`, width: 1.6 });
    this.plot = new Plot(box, {
      id, lines, quantities: [quantity, "force"], x: { label: "x" }, y: { label: "y", size: 3.1 }, zoomed: show_zoom,
      limits: () => this.limits ? [...shown_range(quantity, this.limits.x), ...shown_range("force", this.limits.y)] : [],
      values: (plot, left, top, ratio) => this.values(plot.nearest(left, top, ratio)), after: (plot) => this.draw_dot(plot),
    });
    this.name_axes();
  }
  name_axes() {
    const { x, y } = this.plot.options;
    x.label = with_unit_of(this.name, this.quantity); y.label = with_unit_of("force", "force");
    this.x_range = new Range(); this.y_range = new Range(); this.plot.view = null; this.plot.build();
  }
  values(found) {
    if (!found) return null;
    const [xs, ys] = this.plot.lines[found.line];
    const text = `${this.names[found.line] || ""}\n${this.name} ${with_unit(this.quantity, xs[found.index])}\nforce ${with_unit("force", ys[found.index])}`;
    return { text, left: found.left, top: found.top };
  }
  // live: { series, period_s, moving } or null; overlays: [{ name, series } or null] by place; least: SI half ranges
  draw(live, overlays, limits, least) {
    this.limits = limits;
    const lines = [[[], []], [[], []]], names = ["previous cycle", "this cycle"];
    this.dot = null;
    const xs = live && live.series.get(this.x_channel), fs = live && live.series.get(LOOP_F), n = xs && fs ? Math.min(xs.t.length, fs.t.length) : 0;
    if (n) {
      const end = fs.t[n - 1], begin = place_of(fs.t, end - live.period_s), before = place_of(fs.t, end - 2 * live.period_s);
      lines[0] = [xs.y.slice(before, begin + 1), fs.y.slice(before, begin + 1)];
      lines[1] = [xs.y.slice(begin, n), fs.y.slice(begin, n)];
      this.dot = [xs.y[n - 1], fs.y[n - 1]];
    }
    for (const one of overlays) {
      names.push(one ? one.name : "");
      lines.push(one ? [one.series.get(this.x_channel).y, one.series.get(LOOP_F).y] : [[], []]);
    }
    this.names = names;
    const x = [Infinity, -Infinity], y = [Infinity, -Infinity];
    for (const [across, up] of lines) for (let i = 0; i < across.length; i++) {
      if (across[i] < x[0]) x[0] = across[i];
      if (across[i] > x[1]) x[1] = across[i];
      if (up[i] < y[0]) y[0] = up[i];
      if (up[i] > y[1]) y[1] = up[i];
    }
    const shrink = !live || live.moving;
    this.plot.draw(lines, {
      x: this.x_range.follow(...shown_range(this.quantity, x), magnitude(this.quantity, least.x), shrink),
      y: this.y_range.follow(...shown_range("force", y), magnitude("force", least.y), shrink),
    });
  }
  draw_dot({ plot, scaled }) {
    if (!this.dot) return;
    const { ctx: pen, bbox } = plot, x = scaled.px(this.dot[0]), y = scaled.py(this.dot[1]);
    if (x < bbox.left || x > bbox.left + bbox.width || y < bbox.top || y > bbox.top + bbox.height) return;
    pen.beginPath(); pen.fillStyle = colour("--second"); pen.arc(x, y, 0.3 * rem() * (window.devicePixelRatio || 1), 0, 7); pen.fill();
  }
}

// Lanes over one time axis. Zoomed in, they keep the samples that they show, while the rig goes on.
class StripChart {
  constructor(box, lanes) { Object.assign(this, { box, zero: 0, lanes: [] }); this.set(lanes); }
  set(lanes) {
    for (const lane of this.lanes) if (lane.plot.plot) lane.plot.plot.destroy();
    this.box.replaceChildren(); this.kept = false; this.box.closest("section").querySelector(".reset").hidden = true;
    this.lanes = lanes.map((lane, index) => {
      const area = element("div", undefined, "lane"); this.box.append(area);
      if (index === 0) { area.id = "lanes"; area.tabIndex = 0; area.setAttribute("aria-label", "All channels over time. Left and right arrow keys show values, + and - zoom, 0 resets."); area.setAttribute("role", "img"); }
      const last = index === lanes.length - 1;
      if (last) area.classList.add("last");
      const plot = new Plot(area, {
        id: `strip-${lane.id}`, x_only: true, sync: "strips", quantities: ["plain", lane.quantity], silent: true,
        lines: lane.channels.map((channel, line) => ({ colour: ["--now", "--second", "--third", "--fourth"][line % 4], dash: line ? [0.5, 0.3] : undefined, path: (pen, ts, ys, px, py) => draw_by_columns(pen, ts, ys, px, py, channel === COMMANDED) })),
        x: { show: last, values: (self, splits) => splits.map((split) => `${plain(Number((split - this.zero).toFixed(3)))} s`), splits: (self, axis, low, high) => this.splits(low, high) }, y: { label: lane.id, size: 3.1 },
        limits: () => [NaN, NaN, ...lane.limits()], zoomed: (self) => this.zoomed(self), values: (self, left) => this.values(self, left),
      });
      return { ...lane, plot, range: new Range() };
    });
    this.name_axes();
  }
  name_axes() {
    for (const lane of this.lanes) { lane.plot.options.y.label = with_unit_of(lane.name, lane.quantity); lane.range = new Range(); lane.plot.build(); }
  }
  splits(low, high) {
    const step = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20].find((one) => (high - low) / one <= Math.max(2, this.lanes[0].plot.box.clientWidth / (5 * rem()))) || 50;
    const found = []; for (let at = Math.ceil((low - this.zero) / step - 1e-6) * step; at <= high - this.zero + 1e-6; at += step) found.push(this.zero + at);
    return found;
  }
  // The last `window_s` until `end`; times on the axis count from `zero`.
  draw(series, end, window_s, zero) {
    if (this.kept) return;
    const from = end - window_s;
    this.zero = zero;
    for (const lane of this.lanes) {
      const lines = lane.channels.map((channel) => {
        const one = series.get(channel);
        if (!one) return [[], []];
        const begin = Math.max(0, place_of(one.t, from) - 1);
        return [one.t.slice(begin), one.y.slice(begin)];
      });
      this.show(lane, lines, [from, end]);
    }
  }
  show(lane, lines, x) {
    let low = Infinity, high = -Infinity;
    for (const [, ys] of lines) for (let i = 0; i < ys.length; i++) { if (ys[i] < low) low = ys[i]; if (ys[i] > high) high = ys[i]; }
    const least = Math.max(lane.least() / QUANTITIES[lane.quantity].scale, low <= high ? 0.005 * Math.max(Math.abs(low), Math.abs(high)) / QUANTITIES[lane.quantity].scale : 0);
    lane.plot.draw(lines, { x, y: lane.range.follow(...(low <= high ? shown_range(lane.quantity, [low, high]) : [0, 0]), least) });
  }
  zoomed(plot) {
    this.kept = Boolean(plot.view);
    for (const lane of this.lanes) if (lane.plot !== plot && lane.plot.view !== plot.view) { lane.plot.view = plot.view && { x: plot.view.x, y: lane.plot.range.y }; lane.plot.show(); }
    if (plot.view) plot.view.y = plot.range.y;
    show_zoom(plot);
    if (!plot.view) redraw();
  }
  reset() { this.lanes[0].plot.reset(); }
  values(plot, left) {
    const { x } = plot.shown_range(), per_px = (x[1] - x[0]) / plot.plot.over.clientWidth, at = x[0] + per_px * left, reach_s = NEAR_PX * per_px, parts = [`${(at - this.zero).toFixed(2)} s`];
    for (const lane of this.lanes) lane.plot.lines.forEach(([times, values], line) => {
      if (!values.length) return;
      const after = place_of(times, at), place = after === times.length || (after > 0 && at - times[after - 1] < times[after] - at) ? after - 1 : after;
      const usual_s = times.length > 1 ? (times[times.length - 1] - times[0]) / (times.length - 1) : 0; // between two samples
      const near = Math.abs(times[place] - at) <= Math.max(reach_s, 1.5 * usual_s);
      parts.push(`${lane.called(lane.channels[line])} ${near ? with_unit(lane.quantity, values[place]) : "–"}`);
    });
    const text = parts.join("; ");
    if (by_id("strip-values").textContent !== text) by_id("strip-values").textContent = text;
    return { text };
  }
}

// One value or two for each point of the campaign, in the order of the matrix.
class TrendChart {
  constructor(box, id, quantity, name, lines) {
    Object.assign(this, { quantity, name, lines, range: new Range(), points: [] });
    this.plot = new Plot(box, {
      id, x_only: true, sync: "trends", quantities: ["plain", quantity], zoomed: show_zoom, lines: [...lines.map((line) => ({ colour: line.colour, width: 1.4, path: draw_with_dots })), { colour: "--dim", width: 1.4, path: draw_crosses }],
      x: { label: "point of the matrix", values: (plot, splits) => splits.map((split) => Number.isInteger(split) ? String(split) : "") }, y: { label: name, size: 3.1 },
      values: (plot, left) => this.values(left), pressed: (plot) => { if (this.at && !(performance.now() - plot.dragged < 300)) choose(this.at); },
    });
    this.name_axes();
  }
  name_axes() { this.plot.options.y.label = with_unit_of(this.name, this.quantity); this.range = new Range(); this.plot.build(); }
  draw(points) { // [{ id, described, values: [SI, ...] or null, unfit }]; unfit ones are crosses off the lines
    this.points = points;
    const lines = this.lines.map((line, index) => {
      const xs = [], ys = [];
      points.forEach((one, place) => { if (one.values && !one.unfit && isFinite(one.values[index])) { xs.push(place + 1); ys.push(one.values[index]); } });
      return [xs, ys];
    });
    const crosses = [[], []];
    points.forEach((one, place) => { if (one.values && one.unfit) for (const value of one.values) if (isFinite(value)) { crosses[0].push(place + 1); crosses[1].push(value); } });
    lines.push(crosses);
    this.plot.box.closest("section").querySelector(".unfit").hidden = !crosses[0].length;
    const all = lines.flatMap(([, ys]) => ys), y = all.length ? shown_range(this.quantity, [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))]) : [0, 0];
    this.plot.draw(lines, { x: [0.5, Math.max(1.5, points.length + 0.5)], y: this.range.follow(...y, Math.max(1 / QUANTITIES[this.quantity].scale, 0.02 * Math.max(...y.map(Math.abs)))) });
  }
  values(left) {
    const { x } = this.plot.shown_range(), over = this.plot.plot.over, place = Math.round(x[0] + (x[1] - x[0]) * left / over.clientWidth) - 1, one = this.points[place];
    this.at = one && one.values ? one.id : null;
    if (!one) return null;
    const values = one.values ? this.lines.map((line, index) => `${line.name} ${with_unit(this.quantity, one.values[index])}`) : ["not measured"];
    return { text: [`${one.id}: ${one.described}${one.unfit ? " (invalid)" : ""}`, ...values].join("\n") };
  }
}

// Lines over one axis of numbers: trials, frequencies, seconds of a record.
class CurveChart {
  // across: { label, text(x), ticks(x) }; lines: [{ name, colour, dash, dots }]; least: half range of the values (SI), low and high: fixed ends
  constructor(box, id, across, quantity, name, lines, { least = 1e-9, low = NaN, high = NaN, sync } = {}) {
    Object.assign(this, { quantity, name, lines, across, least, low, high, range: new Range(), xs: [], columns: [] });
    this.plot = new Plot(box, {
      id, x_only: true, sync, quantities: ["plain", quantity], zoomed: show_zoom, lines: lines.map((line) => ({ colour: line.colour, width: 1.4, dash: line.dash ? [0.5, 0.3] : undefined, path: line.dots ? draw_with_dots : draw_known })),
      x: { label: across.label, ...(across.ticks ? { values: (plot, splits) => splits.map(across.ticks) } : {}) }, y: { label: name, size: 3.1 }, values: (plot, left) => this.values(left),
    });
    this.name_axes();
  }
  use(quantity, name) { if (quantity !== this.quantity) { this.quantity = quantity; this.name = name; this.plot.options.quantities = ["plain", quantity]; this.name_axes(); } }
  name_axes() { this.plot.options.y.label = with_unit_of(this.name, this.quantity); this.range = new Range(); this.plot.view = null; this.plot.build(); }
  draw(xs, columns) { // columns: values of each line (SI; null: unknown)
    this.xs = xs; this.columns = columns.map((values) => values.map((value) => value === null ? NaN : value));
    const all = this.columns.flat().filter(isFinite), ends = all.length ? [all.reduce((a, b) => Math.min(a, b)), all.reduce((a, b) => Math.max(a, b))] : [0, 0];
    const needed = shown_range(this.quantity, ends), y = this.range.follow(...needed, this.half_range(needed));
    this.plot.draw(this.columns.map((values) => [xs, values]), {
      x: this.x_range(xs),
      y: [isFinite(this.low) ? shown(this.quantity, this.low) : y[0], isFinite(this.high) ? shown(this.quantity, this.high) : y[1]],
    });
  }
  x_range(xs) { return [xs[0] || 0, Math.max(xs[xs.length - 1] || 0, (xs[0] || 0) + 1)]; }
  half_range() { return magnitude(this.quantity, this.least); } // the least one
  values(left) {
    const { x } = this.plot.shown_range(), at = x[0] + (x[1] - x[0]) * left / this.plot.plot.over.clientWidth;
    if (!this.xs.length) return null;
    const after = Math.min(place_of(this.xs, at), this.xs.length - 1), place = after > 0 && at - this.xs[after - 1] < this.xs[after] - at ? after - 1 : after;
    const values = this.lines.map((line, index) => `${line.name} ${isFinite(this.columns[index][place]) ? with_unit(this.quantity, this.columns[index][place]) : "–"}`);
    return { text: [this.across.text(this.xs[place]), ...values].join("\n") };
  }
}
// Medians of the cycles of an endurance test over their number.
class WearChart extends CurveChart {
  constructor(box, id, quantity, name, lines) {
    const count = (cycles) => cycles.toLocaleString("en-US");
    super(box, id, { label: "cycles", text: (cycles) => `${count(cycles)} cycles`, ticks: count }, quantity, name, lines.map((line) => ({ ...line, dots: true })), { sync: "wear" });
  }
  draw(cycles, columns) {
    this.plot.box.closest("section").hidden = !columns.flat().some((value) => value !== null && isFinite(value));
    super.draw(cycles, columns);
  }
  x_range(cycles) { return [0, Math.max(1, 1.12 * cycles[cycles.length - 1] || 1)]; }
  half_range(y) { return Math.max(1e-3, 0.02 * Math.max(...y.map(Math.abs))); }
}
function draw_known(pen, xs, ys, px, py) {
  let on = false;
  for (let i = 0; i < xs.length; i++) { if (!isFinite(ys[i])) { on = false; continue; } if (on) pen.lineTo(px(xs[i]), py(ys[i])); else pen.moveTo(px(xs[i]), py(ys[i])); on = true; }
}

QUANTITIES.energy = { unit: "J", scale: 1, offset: 0, sign: 1 };
QUANTITIES.share = { unit: "%", scale: 0.01, offset: 0, sign: 1 };
QUANTITIES.plain = { unit: "", scale: 1, offset: 0, sign: 1 };
function show_zoom(plot) {
  const button = plot.box.closest("section").querySelector(".reset");
  if (button) button.hidden = !plot.view;
}
