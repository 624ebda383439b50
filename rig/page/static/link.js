// The connection: age of the displayed data, and the outcome of a stop. An open socket proves nothing: after a phone was
// suspended or a cable unplugged it stays open for minutes, and a slow one delivers old samples as if they were current.

const SILENT_S = 2, GIVEN_UP_S = 6, STOP_TRIED_S = 10, STOP_SEEN_S = 15, ASK_EVERY_MS = 1000;
let socket = null, opened_at = 0, heard_at = 0, asked_at = 0, clock = null, waiting = 0;
let stop_asked = null; // { at, sent, taken, failed }: the last press of Stop

const token = new URLSearchParams(location.search).get("token") || "";
const with_token = (path, own = token) => `${path}?token=${encodeURIComponent(own)}`;
let finished_run = new URLSearchParams(location.search).get("run") || ""; // shown in this browser while the rig is not in use
let key = sessionStorage.getItem("rig-page-key");
if (!key) {
  key = [...crypto.getRandomValues(new Uint8Array(18))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  sessionStorage.setItem("rig-page-key", key);
}

function connect() {
  clearTimeout(waiting);
  if (socket) { socket.onopen = socket.onmessage = socket.onclose = null; socket.close(); }
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws?token=${encodeURIComponent(token)}&client=${key}&view=${document.documentElement.dataset.view || ""}&run=${encodeURIComponent(finished_run)}`);
  socket.binaryType = "arraybuffer"; opened_at = performance.now(); asked_at = 0; clock = null;
  socket.onopen = () => { heard_at = performance.now(); ask_clock(); send_stop(); };
  socket.onmessage = (event) => { heard_at = performance.now(); if (typeof event.data === "string") whole(JSON.parse(event.data)); else frame(event.data); };
  socket.onclose = () => { socket = null; judge(); waiting = setTimeout(connect, 1000); };
}
const pieces = {}; // of a message with many points, by its type
function whole(message) {
  if (message.type === "points") {
    const listed = Array.isArray(message.points);
    if (message.begin) pieces[message.of] = listed ? [] : {};
    if (listed) pieces[message.of].push(...message.points); else Object.assign(pieces[message.of], message.points);
    return;
  }
  if (message.points === null) message.points = pieces[message.type];
  take(message);
}
function is_open() { return Boolean(socket) && socket.readyState === WebSocket.OPEN; }
function say(message) {
  if (!is_open()) return false;
  socket.send(JSON.stringify(message)); return true;
}

// An answer is queued behind all data that wait in the same connection: its round-trip time is the age of the display.
function ask_clock() { if (!asked_at && say({ do: "clock", sent: performance.now() })) asked_at = performance.now(); }
function clock_answered(message) {
  const there = performance.now(), took = there - message.sent;
  asked_at = 0;
  if (!clock || took < clock.took || there - clock.at > 60000) clock = { took, at: there, offset_s: message.host_s - (there - took / 2) / 1000 };
}
function silence_s() {
  const now = performance.now();
  return Math.max(now - heard_at, asked_at ? now - asked_at : 0) / 1000;
}
function connected() { return is_open() && silence_s() < SILENT_S; }
let informed = false; // the server has sent the complete state
function opening() { return !informed && performance.now() < 1000 * GIVEN_UP_S; } // just opened: nothing is known yet
function look_after() {
  if (socket && socket.readyState === WebSocket.CONNECTING ? performance.now() - opened_at > 1000 * GIVEN_UP_S : is_open() && silence_s() > GIVEN_UP_S) connect();
  if (stop_asked && !stop_asked.taken && performance.now() - stop_asked.at > 1000 * STOP_TRIED_S) stop_asked.failed = true;
  if (stop_asked && stop_asked.failed && connected()) { stop_asked = null; answer("The last stop command did not reach the rig. Press STOP again."); }
  if (stop_asked && stop_asked.taken && performance.now() - stop_asked.taken > 1000 * STOP_SEEN_S) stop_asked = null;
  answer_over(); judge();
  if (!connected()) gauges(); // no frame arrives that would mark them as old
}
setInterval(ask_clock, ASK_EVERY_MS);
document.addEventListener("visibilitychange", look_after);
window.addEventListener("pageshow", look_after);

// A stop pressed while disconnected is sent on reconnection, within a few seconds; the page shows whether it was accepted.
function stop() { stop_asked = { at: performance.now(), sent: false, taken: 0, failed: false }; send_stop(); judge(); }
function send_stop() { if (stop_asked && !stop_asked.taken && !stop_asked.failed) stop_asked.sent = say({ do: "stop", name: by_id("name").value }); }
function stop_answered(message) {
  if (message.ok && stop_asked) stop_asked.taken = performance.now();
  if (!message.ok) stop_asked = null;
}

by_id("stop").onclick = stop;
document.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "checkbox";
  if (!typing && !event.repeat && !event.ctrlKey && !event.altKey && !event.metaKey && (event.key === "s" || event.key === "S") && !by_id("stop").hidden) stop();
});
by_id("lease").onsubmit = (event) => {
  event.preventDefault();
  if (typeof looks_like_serial === "function" && looks_like_serial(by_id("name").value)) { // a reader typed into the wrong field
    line_note(`${by_id("name").value.trim()}: this serial number was scanned into the field for your name; nothing was started. Scan it again.`);
    by_id("name").value = ""; by_id("scan").focus(); return;
  }
  say({ do: "lease", name: by_id("name").value });
};
by_id("release").onclick = () => say({ do: "release" });
