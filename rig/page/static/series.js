"use strict";
// Binary frames to series. Of the rig, only the layout of a frame is used here (samples.py).

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
function id_of(buffer) { // of a recorded point, after the blocks
  const view = new DataView(buffer);
  let at = 24;
  for (let block = view.getUint32(4, true); block > 0; block--) at += 8 + 8 * view.getUint32(at + 4, true);
  return new TextDecoder().decode(new Uint8Array(buffer, at));
}
function place_of(times, time) { // of the first one that is not before it
  let low = 0, high = times.length;
  while (low < high) { const middle = (low + high) >> 1; if (times[middle] < time) low = middle + 1; else high = middle; }
  return low;
}
