// State from the server to the page, wishes of the operator back. Every text is set as text, never as markup.

const by_id = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") || "";
let key = sessionStorage.getItem("rig-page-key");
if (!key) {
  key = [...crypto.getRandomValues(new Uint8Array(18))].map((byte) => byte.toString(16).padStart(2, "0")).join("");
  sessionStorage.setItem("rig-page-key", key);
}
const series = new Map();
let socket = null, run = null, state = {}, results = {}, standing = {}, host_now = 0, host_at = 0, drawn = true, stopping = 0;
let clock = null;
const latencies_ms = [];
window.rigPage = { series, latencies_ms, get state() { return state; }, get run() { return run; }, frames: 0 };

const MESSAGES = {
  "lease-taken": "Somebody else has control.", "not-running": "No campaign is running.", "viewer": "This is a viewer's page: it may only stop.",
  "no-lease": "Take control first.", "name-missing": "Type your name first.", "not-reached": "The campaign does not answer.",
};

function limit(name) { const value = run && run.limits ? run.limits[name] : null; return typeof value === "number" ? value : Infinity; }
function stroke() { const span = run && run.limits ? run.limits.position_m : null; return Array.isArray(span) ? span.map((m) => 1000 * m) : [-Infinity, Infinity]; }
const GAUGES = [
  { name: "Force", unit: "N", channel: 1, factor: 1, range: () => [-limit("force_N"), limit("force_N")] },
  { name: "Displacement", unit: "mm", channel: 2, factor: 1000, range: stroke },
  { name: "Velocity", unit: "m/s", channel: LOOP_V, factor: 1, range: () => [-limit("speed_m_s"), limit("speed_m_s")] },
  { name: "Coil current", unit: "A", channel: 10, factor: 1, range: () => [-limit("current_A"), limit("current_A")] },
  { name: "Coil temperature", unit: "°C", channel: 11, factor: 1, one: true, range: () => [0, limit("coil_temperature_degC")] },
  { name: "ECU temperature", unit: "°C", channel: 12, factor: 1, one: true, range: () => [0, Infinity] },
  { name: "Supply pressure", unit: "bar", channel: 26, factor: 1e-5, one: true, range: () => [0, Infinity] },
];
const loops = [
  [new LoopChart(by_id("fx"), LOOP_X, 1000, "displacement in mm"), () => ({ x: stroke(), y: limit("force_N") })],
  [new LoopChart(by_id("fv"), LOOP_V, 1, "velocity in m/s"), () => ({ x: [-limit("speed_m_s"), limit("speed_m_s")], y: limit("force_N") })],
];
const strips = new StripChart(by_id("strips"), [
  { name: "F / N", channels: [1], factor: 1, least: 5, limits: () => [-limit("force_N"), limit("force_N")] },
  { name: "x / mm", channels: [2, 20], factor: 1000, least: 0.5, limits: stroke },
  { name: "I / A", channels: [10, 16], factor: 1, least: 0.1, limits: () => [-limit("current_A"), limit("current_A")] },
  { name: "T / °C", channels: [11, 12, 3, 4, 5, 6, 7, 8, 9], factor: 1, least: 2, limits: () => [-Infinity, limit("coil_temperature_degC")] },
]);

function element(name, text, kind) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}

function now_s() { return host_now ? host_now + (performance.now() - host_at) / 1000 : 0; }
function clock_s() { return clock ? performance.now() / 1000 + clock.offset_s : now_s(); }
function point() { return run ? run.points.find((one) => one.id === state.point) : undefined; }
function period_s() { const one = point(); return one && one.frequency_Hz > 0 ? 1 / one.frequency_Hz / (run.device_rate || 1) : 2; }
function duration(s) {
  if (typeof s !== "number") return "";
  return s >= 3600 ? `${Math.floor(s / 3600)} h ${Math.round(s % 3600 / 60)} min` : s >= 60 ? `${Math.floor(s / 60)} min ${Math.round(s % 60)} s` : `${Math.max(0, Math.round(s))} s`;
}
function describe(one) {
  return `${one.waveform} ${plain(1000 * one.amplitude_m)} mm, ${plain(one.frequency_Hz)} Hz, ${plain(one.current_A)} A`;
}

function connect() {
  socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws?token=${encodeURIComponent(token)}&client=${key}`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { clock = null; for (let i = 0; i < 5; i++) setTimeout(() => say({ do: "clock", sent: performance.now() }), 200 * i); };
  socket.onmessage = (event) => typeof event.data === "string" ? take(JSON.parse(event.data)) : frame(event.data);
  socket.onclose = () => { socket = null; judge(); setTimeout(connect, 1000); };
}
function say(message) {
  if (socket && socket.readyState === WebSocket.OPEN) { socket.send(JSON.stringify(message)); return true; }
  return false;
}
function frame(buffer) {
  host_now = read_frame(buffer, series); host_at = performance.now(); window.rigPage.frames++;
  if (drawn) { drawn = false; requestAnimationFrame(draw); }
}
function draw() {
  loop_keep_s = Math.max(1, 2.5 * period_s());
  for (const [chart, limits] of loops) chart.draw(series, period_s(), limits());
  strips.draw(series, now_s()); gauges(); drawn = true;
  const newest = series.get(23); // arrivals at the host, whatever the devices' clocks say
  if (newest && clock) { latencies_ms.push(1000 * (clock_s() - newest.last_t)); if (latencies_ms.length > 5000) latencies_ms.shift(); }
}

function take(message) {
  if (message.type === "run") { run = message; lamps(); matrix(); by_id("name-of-run").textContent = run.name; }
  else if (message.type === "state") { state = message; progress(); confirmations(); buttons(); }
  else if (message.type === "results") { results = message.points; matrix(); }
  else if (message.type === "events") events(message);
  else if (message.type === "standing") { standing = message; show_standing(); }
  else if (message.type === "answer") answered(message);
  judge();
}

function answered(message) {
  if (message.do === "clock" && message.ok) {
    const there = performance.now(), took = there - message.sent;
    if (!clock || took < clock.took) clock = { took, offset_s: message.host_s - (there - took / 2) / 1000 };
    return;
  }
  if (message.do === "explain" && message.ok) { explain(message); return; }
  if (message.do === "stop") stopping = message.ok ? performance.now() : 0;
  const text = message.refused ? (MESSAGES[message.refused] || message.refused) : message.do === "words" ? "Kept in the run." : "";
  by_id("answer").textContent = text;
}

function stale() {
  if (!run || !state.running || !host_now) return [];
  const late = run.devices.filter((one) => series.has(one.channel) && now_s() - series.get(one.channel).last_t > Math.max(one.stale_after_s, 0.2) + 0.15).map((one) => one.name);
  if (state.host_ns && now_s() - state.host_ns * 1e-9 > 2) late.push("application");
  return late;
}

function opinion() {
  if (!socket || socket.readyState !== WebSocket.OPEN) return ["bad", "✗", "NO CONNECTION", "The page has lost the rig. Go and look; stop there."];
  const ended = state.ended;
  if (ended) {
    const lines = (ended.lines || []).join(" ");
    if (ended.rig_state === "unknown") return ["bad", "✗", "NOT OK", "RIG STATE UNKNOWN: go and look. " + lines];
    if (ended.stopped_by) return ["bad", "■", "STOPPED", lines || ended.stopped_by];
    if (ended.valid < ended.total) return ["bad", "✗", "NOT OK", `${ended.valid} of ${ended.total} points valid. ${lines}`];
    return ["good", "✓", "OK", `finished: all ${ended.total} points valid`];
  }
  if (!state.running) return state.phase === undefined ? ["wait", "…", "WAITING", "for the campaign"] : ["wait", "■", "ENDED", "No campaign is running here."];
  if (stopping || state.phase === "stopping") return ["bad", "■", "STOPPING", "coil to 0 A, motion fades out"];
  const late = stale();
  if (late.length) return ["bad", "✗", "NOT OK", `no fresh data from: ${late.join(", ")}`];
  const invalid = Object.entries(results).filter(([, one]) => one.verdict === "invalid").map(([id]) => id);
  if (invalid.length) return ["bad", "✗", "NOT OK", `invalid: ${invalid.join(", ")}`];
  if (state.held) return ["wait", "Ⅱ", "READY", "waiting for Start"];
  const suspect = Object.entries(results).filter(([, one]) => one.verdict === "suspect").map(([id]) => id);
  if (state.phase === "paused") return ["wait", "Ⅱ", "PAUSED", "Start continues"];
  const what = `${state.phase || ""}${state.paused ? "; pausing after this point" : ""}`;
  if (suspect.length) return ["bad", "?", "LOOK", `suspect: ${suspect.join(", ")}; ${what}`];
  return ["good", "✓", "OK", what];
}

function judge() {
  const [kind, sign, verdict, why] = opinion();
  const banner = by_id("banner");
  if (banner.className !== kind) banner.className = kind;
  for (const [id, text] of [["sign", sign], ["verdict", verdict], ["why", why]]) if (by_id(id).textContent !== text) by_id(id).textContent = text;
  by_id("stop").classList.toggle("sent", Boolean(stopping) && !state.ended);
  document.title = `${verdict} – MR damper rig`;
  ages();
}

function progress() {
  const one = point(), total = run ? run.points.length : 0, done = Object.keys(results).length;
  by_id("point").textContent = one && !state.ended ? `${one.id}: ${describe(one)}` : state.ended ? "ended" : "–";
  by_id("phase").textContent = state.ended ? "" : `${state.phase || ""}${one && state.cycles ? `, cycle ${state.cycles} of ${Math.round(one.cycles)}` : ""}`;
  by_id("left").textContent = state.ended || !state.running ? "" : typeof state.time_left_s === "number" ? `${duration(state.time_left_s)} left` : "";
  const share = total ? 100 * Math.min(1, (done + (one && one.cycles && !results[one.id] ? Math.min(1, state.cycles / one.cycles) : 0)) / total) : 0;
  by_id("done").style.width = `${share}%`;
  by_id("bar").setAttribute("aria-valuenow", share.toFixed(0));
  document.querySelectorAll("#matrix li").forEach((item) => item.classList.toggle("running", item.dataset.id === state.point && !state.ended));
}

function matrix() {
  const list = by_id("matrix"); list.replaceChildren();
  const points = run ? run.points : [];
  for (const one of points) {
    const judged = results[one.id] || {}, verdict = judged.verdict || "";
    const mark = { valid: "✓", suspect: "?", invalid: "✗" }[verdict] || "·";
    const item = element("li", undefined, verdict); item.dataset.id = one.id;
    item.append(element("b", `${mark} ${one.id} `), element("span", verdict ? `${verdict} ` : ""), element("div", describe(one)));
    if (judged.reasons && judged.reasons.length) item.title = judged.reasons.join("\n");
    list.append(item);
  }
  const valid = Object.values(results).filter((one) => one.verdict === "valid").length;
  by_id("count").textContent = points.length ? `– ${valid} valid, ${Object.keys(results).length} of ${points.length} done; specimen ${run.specimen}` : "";
  const last = Object.keys(results).pop();
  if (last) {
    const judged = results[last], one = points.find((each) => each.id === last);
    by_id("last").textContent = `Last result: ${last} ${judged.verdict}${one ? ` (${describe(one)})` : ""}${judged.reasons && judged.reasons.length ? `: ${judged.reasons.join("; ")}` : ""}`;
  }
  progress();
}

function lamps() {
  const list = by_id("lamps"); list.replaceChildren();
  for (const one of [...run.devices, { name: "application", channel: -1, stale_after_s: 2 }]) {
    const item = element("li"); item.dataset.channel = one.channel; item.dataset.stale = one.stale_after_s;
    item.append(element("span", "·", "mark"), element("span", one.name), element("span", "", "age"));
    list.append(item);
  }
}
function ages() {
  for (const item of document.querySelectorAll("#lamps li")) {
    const channel = Number(item.dataset.channel), last = channel < 0 ? (state.host_ns || 0) * 1e-9 : series.has(channel) ? series.get(channel).last_t : 0;
    const known = last > 0 && host_now > 0, age = Math.max(0, now_s() - last), over = age > Math.max(Number(item.dataset.stale), 0.2) + 0.15;
    const kind = !known || !state.running ? "" : over ? "bad" : "good";
    item.className = kind; item.children[0].textContent = kind === "good" ? "✓" : kind === "bad" ? "✗" : "·";
    item.children[2].textContent = !known ? "nothing yet" : !state.running ? "ended" : age < 1 ? "fresh (< 1 s)" : `${age.toFixed(age < 10 ? 1 : 0)} s old`;
  }
}

function gauges() {
  const box = by_id("gauges");
  for (const gauge of GAUGES) {
    const one = series.get(gauge.channel);
    if (!one || !isFinite(one.last)) continue;
    if (!gauge.box) {
      gauge.box = element("div", undefined, gauge.one ? "gauge one" : "gauge");
      gauge.value = element("div", undefined, "value"); gauge.text = element("b"); gauge.value.append(element("span", gauge.name), gauge.text);
      gauge.track = element("div", undefined, "track"); gauge.hand = element("div", undefined, "hand"); gauge.track.append(gauge.hand);
      gauge.note = element("div", "", "small"); gauge.box.append(gauge.value, gauge.track, gauge.note); box.append(gauge.box);
    }
    const value = one.last * gauge.factor, [low, high] = gauge.range();
    gauge.text.textContent = `${number(value)} ${gauge.unit}`;
    const bounded = isFinite(low) && isFinite(high) && high > low;
    gauge.track.hidden = !bounded;
    if (bounded) {
      gauge.hand.style.left = `${Math.min(100, Math.max(0, 100 * (value - low) / (high - low)))}%`;
      gauge.note.textContent = gauge.one ? `limit ${plain(high)} ${gauge.unit}` : `limits ${plain(low)} to ${plain(high)} ${gauge.unit}`;
      gauge.box.classList.toggle("over", value < low || value > high);
    }
  }
}

function events(message) {
  const list = by_id("events");
  if (message.all) list.replaceChildren();
  for (const one of message.events) {
    const item = element("li", undefined, one.level);
    const mark = { error: "✗ ", warning: "! " }[one.level] || "";
    item.append(element("span", `${mark}${one.utc.slice(11, 19)} `));
    if (one.slug) {
      const button = element("button", one.slug); button.type = "button"; button.title = "explain";
      button.onclick = () => say({ do: "explain", slug: one.slug }); item.append(button);
    }
    item.append(element("span", ` ${one.by ? `${one.by}: ` : ""}${one.text}`));
    if (one.slug && one.level !== "info") {
      const seen = element("button", "seen"); seen.type = "button"; seen.title = "acknowledge";
      seen.onclick = () => { if (say({ do: "words", acknowledged: one.slug }) && standing.mine) seen.disabled = true; }; item.append(" ", seen);
    }
    list.prepend(item);
  }
  while (list.children.length > 200) list.lastChild.remove();
}
function explain(message) {
  const box = by_id("explanation"); box.replaceChildren(element("b", message.slug), element("p", message.means));
  if (message.done) box.append(element("p", message.done));
  const look = element("ul"); for (const text of message.look_at) look.append(element("li", `• look at: ${text}`));
  const close = element("button", "Close"); close.type = "button"; close.onclick = () => { box.hidden = true; };
  box.append(look, element("p", message.resume || ""), close); box.hidden = false; close.focus();
}

function show_standing() {
  const mine = standing.mine, viewer = standing.role === "viewer";
  by_id("standing").textContent = mine ? `You have control, ${standing.holder}.` : standing.holder ? `${standing.holder} has control.` : viewer ? "You are looking on; you may stop." : "Nobody has control.";
  by_id("lease").hidden = viewer; by_id("words").hidden = viewer; by_id("take").hidden = mine; by_id("release").hidden = !mine;
  by_id("viewers").hidden = !standing.viewer_url; by_id("viewer-url").textContent = standing.viewer_url || "";
  if (mine && by_id("answer").textContent === MESSAGES["no-lease"]) by_id("answer").textContent = "";
  buttons();
}
function confirmations() {
  const box = by_id("confirm"), stops = state.held ? state.confirm || [] : [];
  const wanted = stops.map((one) => one.slug).join(" ");
  if (box.dataset.slugs === wanted) return;
  box.dataset.slugs = wanted; box.replaceChildren();
  for (const one of stops) {
    const label = element("label"), tick = element("input"); tick.type = "checkbox"; tick.value = one.slug; tick.onchange = buttons;
    label.append(tick, element("span", `${one.slug} (${one.stop}): ${one.detail || ""} – looked at ${one.look_at || ""}, and mended`)); box.append(label);
  }
}
function buttons() {
  const ticks = [...document.querySelectorAll("#confirm input")];
  const may = standing.mine && state.running && !state.ended;
  by_id("start").disabled = !may || !(state.held || state.paused) || ticks.some((tick) => !tick.checked);
  by_id("start").textContent = state.paused && !state.held ? "Start (continue)" : "Start";
  by_id("pause").disabled = !may || state.held || state.paused;
  by_id("keep").disabled = !may;
  for (const id of ["start", "pause", "take", "keep"]) by_id(id).hidden = standing.role === "viewer" || (id === "take" && standing.mine);
}

function stop() { stopping = performance.now(); if (!say({ do: "stop" })) by_id("answer").textContent = "Not connected: stop at the rig."; judge(); }
by_id("stop").onclick = stop;
by_id("start").onclick = () => say({ do: "start", confirmed: [...document.querySelectorAll("#confirm input:checked")].map((tick) => tick.value) });
by_id("pause").onclick = () => say({ do: "pause" });
by_id("lease").onsubmit = (event) => { event.preventDefault(); say({ do: "lease", name: by_id("name").value }); };
by_id("release").onclick = () => say({ do: "release" });
by_id("words").onsubmit = (event) => {
  event.preventDefault();
  const words = {}; if (by_id("specimen").value) words.specimen = by_id("specimen").value; if (by_id("note").value) words.note = by_id("note").value;
  if (Object.keys(words).length && say({ do: "words", ...words })) by_id("note").value = "";
};
document.addEventListener("keydown", (event) => {
  const typing = /^(INPUT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "checkbox";
  if (!typing && !event.ctrlKey && !event.altKey && !event.metaKey && (event.key === "s" || event.key === "S")) stop();
});

const dark = window.matchMedia("(prefers-color-scheme: dark)");
function theme() { const chosen = localStorage.getItem("rig-page-theme"); document.documentElement.classList.toggle("dark", chosen ? chosen === "dark" : dark.matches); drawn = true; }
dark.addEventListener("change", theme);
by_id("theme").onclick = () => { localStorage.setItem("rig-page-theme", document.documentElement.classList.contains("dark") ? "light" : "dark"); theme(); };
theme(); connect(); setInterval(judge, 250);
