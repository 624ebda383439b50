"use strict";
// Binary frames to series, series to canvases. Of the rig, only the layout of a frame is used here (samples.py).

const COMMANDED = 16; // A
const LOOP_X = 201, LOOP_V = 202, LOOP_F = 203, WINDOW_S = 20, RECORDED = 2;
let loop_keep_s = 10;

class Series {
  constructor(keep_s) { this.keep_s = keep_s; this.t = []; this.y = []; }
  add(t, y) {
    this.t.push(t); this.y.push(y);
  }
  trim(now) {
    let old = 0;
    while (old < this.t.length && this.t[old] < now - this.keep_s) old++;
    if (old > 512 || (old > 0 && old === this.t.length)) { this.t.splice(0, old); this.y.splice(0, old); }
  }
  get last() { return this.y.length ? this.y[this.y.length - 1] : NaN; }
  get last_t() { return this.t.length ? this.t[this.t.length - 1] : -Infinity; }
}

function kind_of(buffer) { return new DataView(buffer).getUint32(0, true); }
function read_frame(buffer, series, keep_s) {
  const view = new DataView(buffer);
  const blocks = view.getUint32(4, true), base = view.getFloat64(8, true), now = view.getFloat64(16, true);
  let at = 24;
  for (let block = 0; block < blocks; block++) {
    const channel = view.getUint16(at, true), n = view.getUint32(at + 4, true);
    const times = new Float32Array(buffer, at + 8, n), values = new Float32Array(buffer, at + 8 + 4 * n, n);
    at += 8 + 8 * n;
    if (!series.has(channel)) series.set(channel, new Series(keep_s));
    const one = series.get(channel);
    for (let index = 0; index < n; index++) one.add(base + times[index], values[index]);
    if (channel >= LOOP_X && isFinite(keep_s)) one.keep_s = loop_keep_s;
    one.trim(channel >= LOOP_X ? one.last_t : now); // loops have a separate clock
  }
  return now;
}

let colours = new Map(); // read some hundred times per second; discarded when the theme changes
function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}

function prepared(canvas) {
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  }
  const pen = canvas.getContext("2d");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, width, height);
  const size = parseFloat(getComputedStyle(document.documentElement).fontSize);
  pen.font = `${Math.round(0.75 * size)}px system-ui, sans-serif`;
  return { pen, width, height, size };
}

function round_up(value) {
  if (!(value > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((step) => step * power >= value * 0.9999);
}

class LoopChart {
  constructor(canvas, x_channel, x_factor, x_label) {
    Object.assign(this, { canvas, x_channel, x_factor, x_label, x_span: 0, y_span: 0 });
  }
  draw(series, period_s, limits) {
    const { pen, width, height, size } = prepared(this.canvas);
    const xs = series.get(this.x_channel), fs = series.get(LOOP_F);
    const left = 3.4 * size, right = width - 0.6 * size, top = 0.5 * size, bottom = height - 2.2 * size;
    const n = xs && fs ? Math.min(xs.t.length, fs.t.length) : 0;
    const end = n ? fs.t[n - 1] : 0;
    let first = n;
    while (first > 0 && fs.t[first - 1] >= end - 2 * period_s) first--;
    let x_most = 0, y_most = 0;
    for (let i = first; i < n; i++) {
      x_most = Math.max(x_most, Math.abs(xs.y[i] * this.x_factor)); y_most = Math.max(y_most, Math.abs(fs.y[i]));
    }
    this.x_span = this.span(this.x_span, x_most); this.y_span = this.span(this.y_span, y_most);
    const px = (v) => left + (right - left) * (0.5 + 0.5 * v / this.x_span);
    const py = (v) => bottom - (bottom - top) * (0.5 + 0.5 * v / this.y_span);
    this.frame(pen, { left, right, top, bottom, size, px, py }, limits);
    pen.save(); pen.beginPath(); pen.rect(left, top, right - left, bottom - top); pen.clip();
    for (const [from, to, stroke, wide] of [
      [end - 2 * period_s, end - period_s, colour("--before"), 1.5], [end - period_s, end, colour("--now"), 2.6]]) {
      pen.beginPath(); pen.strokeStyle = stroke; pen.lineWidth = wide * size / 16; let on = false;
      for (let i = first; i < n; i++) {
        if (fs.t[i] < from || fs.t[i] > to) continue;
        if (on) pen.lineTo(px(xs.y[i] * this.x_factor), py(fs.y[i])); else pen.moveTo(px(xs.y[i] * this.x_factor), py(fs.y[i]));
        on = true;
      }
      pen.stroke();
    }
    if (n > first && isFinite(period_s)) {
      pen.beginPath(); pen.fillStyle = colour("--second");
      pen.arc(px(xs.y[n - 1] * this.x_factor), py(fs.y[n - 1]), 0.32 * size, 0, 7); pen.fill();
    }
    pen.restore();
  }
  span(before, most) {
    const wanted = round_up(1.08 * most);
    return before > 0 && 1.02 * most <= before && most > 0.55 * before ? before : wanted;
  }
  frame(pen, place, limits) {
    const { left, right, top, bottom, size, px, py } = place;
    pen.fillStyle = colour("--band");
    for (const [low, high, at, far] of [[limits.x[0], limits.x[1], px, this.x_span], [-limits.y, limits.y, py, this.y_span]]) {
      if (!isFinite(low) || !isFinite(high)) continue;
      if (at === px) {
        if (low > -far) pen.fillRect(left, top, px(low) - left, bottom - top);
        if (high < far) pen.fillRect(px(high), top, right - px(high), bottom - top);
      } else {
        if (high < far) pen.fillRect(left, top, right - left, py(high) - top);
        if (low > -far) pen.fillRect(left, py(low), right - left, bottom - py(low));
      }
    }
    pen.strokeStyle = colour("--line"); pen.fillStyle = colour("--text"); pen.lineWidth = 1;
    for (const share of [-1, -0.5, 0, 0.5, 1]) {
      const x = px(share * this.x_span), y = py(share * this.y_span);
      pen.beginPath(); pen.moveTo(x, top); pen.lineTo(x, bottom); pen.moveTo(left, y); pen.lineTo(right, y); pen.stroke();
      pen.textAlign = share === 1 ? "right" : share === -1 ? "left" : "center";
      pen.fillText(number(share * this.x_span), x, bottom + 0.85 * size);
      pen.textAlign = "right"; pen.fillText(number(share * this.y_span), left - 0.25 * size, y + 0.25 * size);
    }
    pen.textAlign = "center"; pen.fillText(this.x_label, (left + right) / 2, bottom + 1.8 * size);
    pen.save(); pen.translate(0.75 * size, (top + bottom) / 2); pen.rotate(-Math.PI / 2);
    pen.fillText("force in N", 0, 0); pen.restore();
  }
}

function number(value) {
  if (!isFinite(value)) return "–";
  const size = Math.abs(value);
  return value.toFixed(size >= 100 || size === 0 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3).replace(/^-(0\.?0*)$/, "$1");
}

// Thousands of samples on some hundred pixel columns: draw the first, extreme and last value of each column. A command is `held` until the next one.
function draw_by_columns(pen, one, since, px, py, held) {
  let column = NaN, x = 0, first = 0, low = 0, high = 0, last = 0, on = false;
  const put = (y) => { if (on) pen.lineTo(x, y); else pen.moveTo(x, y); on = true; };
  const flush = () => {
    put(first);
    if (low < Math.min(first, last)) put(low);
    if (high > Math.max(first, last)) put(high);
    if (last !== first) put(last);
  };
  for (let i = 0; i < one.t.length; i++) {
    if (one.t[i] < since) continue;
    const at = px(one.t[i]), y = py(one.y[i]);
    if (Math.floor(at) === column) { low = Math.min(low, y); high = Math.max(high, y); last = y; continue; }
    if (!isNaN(column)) { flush(); if (held) pen.lineTo(at, last); }
    column = Math.floor(at); x = at; first = low = high = last = y;
  }
  if (!isNaN(column)) flush();
}

class StripChart {
  constructor(canvas, lanes) { this.canvas = canvas; this.lanes = lanes; }
  draw(series, now, [first, last], window_s = WINDOW_S) {
    const { pen, width, height, size } = prepared(this.canvas);
    const left = 4.6 * size, right = width - 0.4 * size, lane_height = (height - 1.3 * size) / this.lanes.length;
    this.lanes.forEach((lane, row) => {
      const top = row * lane_height + 0.3 * size, bottom = (row + 1) * lane_height - 0.2 * size;
      const shown = lane.channels.map((channel) => series.get(channel)).filter(Boolean);
      let low = Infinity, high = -Infinity;
      for (const one of shown) for (let i = 0; i < one.t.length; i++) if (one.t[i] > now - window_s) {
        low = Math.min(low, one.y[i] * lane.factor); high = Math.max(high, one.y[i] * lane.factor);
      }
      if (!isFinite(low)) { low = -1; high = 1; }
      const middle = (low + high) / 2, half = Math.max((high - low) / 2 * 1.1, lane.least);
      const py = (v) => bottom - (bottom - top) * (0.5 + 0.5 * (v - middle) / half);
      pen.fillStyle = colour("--band");
      const [lowest, highest] = lane.limits();
      if (highest < middle + half) pen.fillRect(left, top, right - left, Math.max(0, py(highest) - top));
      if (lowest > middle - half) pen.fillRect(left, py(lowest), right - left, Math.max(0, bottom - py(lowest)));
      pen.strokeStyle = colour("--line"); pen.lineWidth = 1; pen.strokeRect(left, top, right - left, bottom - top);
      pen.fillStyle = colour("--text"); pen.textAlign = "right";
      pen.fillText(number(middle + half), left - 0.25 * size, top + 0.7 * size);
      pen.fillText(number(middle - half), left - 0.25 * size, bottom);
      pen.textAlign = "left"; pen.fillText(lane.name, 0, (top + bottom) / 2 + 0.25 * size);
      pen.save(); pen.beginPath(); pen.rect(left, top, right - left, bottom - top); pen.clip();
      shown.forEach((one, index) => {
        pen.strokeStyle = colour(["--now", "--second", "--third", "--fourth"][index % 4]);
        pen.setLineDash(index ? [0.5 * size, 0.3 * size] : []); pen.lineWidth = 1.8 * size / 16; pen.beginPath();
        draw_by_columns(pen, one, now - window_s, (t) => left + (right - left) * (1 - (now - t) / window_s), (y) => py(y * lane.factor), one === series.get(COMMANDED));
        pen.stroke(); pen.setLineDash([]);
      });
      pen.restore();
    });
    pen.fillStyle = colour("--dim"); pen.textAlign = "left"; pen.fillText(first, left, height - 0.2 * size);
    pen.textAlign = "right"; pen.fillText(last, right, height - 0.2 * size);
  }
}

function plain(value) { return isFinite(value) ? String(Number(value.toPrecision(4))) : "–"; }
