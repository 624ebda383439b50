// State from the server to the page, commands of the operator to the server.

const by_id = (id) => document.getElementById(id);
let series = new Map();
let run = null, state = {}, results = {}, standing = {}, host_now = 0, host_at = 0, first_at = 0, drawn = true, drawn_at = 0;
let recorded = null; // { point, series }: a point of a campaign that has ended
const latencies_ms = [];
window.rigPage = { latencies_ms, get series() { return series; }, get state() { return state; }, get run() { return run; }, get results() { return results; }, get recorded() { return recorded; }, frames: 0 };

const MESSAGES = {
  "lease-taken": "Another operator has control.", "not-running": "No campaign is running.", "viewer": "This page is for viewers; viewers can only stop the rig.",
  "no-lease": "Take control first.", "name-missing": "Type your name first.", "not-reached": "The campaign is not responding.",
  "not-recorded": "The data for this point cannot be read.", "still-running": "Recorded points can be shown only after the campaign has ended.",
  "unknown-slug": "No explanation is available for this code.",
};

function limit(name) { const value = run && run.limits ? run.limits[name] : null; return typeof value === "number" ? value : Infinity; }
function stroke() { const span = run && run.limits ? run.limits.position_m : null; return Array.isArray(span) ? span.map((m) => 1000 * m) : [-Infinity, Infinity]; }
const GAUGES = [
  { name: "Force", unit: "N", channel: 1, factor: 1, range: () => [-limit("force_N"), limit("force_N")] },
  { name: "Displacement", unit: "mm", channel: 2, factor: 1000, range: stroke },
  { name: "Velocity", unit: "m/s", channel: LOOP_V, aged_by: 2, factor: 1, range: () => [-limit("speed_m_s"), limit("speed_m_s")] },
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

function now_s() { return host_now ? host_now + (performance.now() - host_at) / 1000 : 0; }
function clock_s() { return clock ? performance.now() / 1000 + clock.offset_s : now_s(); }
function point(id = state.point) { return run ? run.points.find((one) => one.id === id) : undefined; }
function period_s() { const one = point(); return one && one.repeats !== false && one.frequency_Hz > 0 ? 1 / one.frequency_Hz / (run.device_rate || 1) : 2; }

function frame(buffer) {
  if (kind_of(buffer) === RECORDED) {
    if (recorded) { recorded.series = new Map(); recorded.end_s = read_frame(buffer, recorded.series, Infinity); drawn_at = 0; }
    return;
  }
  if (!first_at) first_at = performance.now();
  host_now = read_frame(buffer, series, WINDOW_S + 1); host_at = performance.now(); window.rigPage.frames++;
  // Nothing moves in a campaign that has ended.
  if (state.running || performance.now() - drawn_at > 1000) redraw();
}
function redraw() { if (drawn) { drawn = false; requestAnimationFrame(draw); } }
function draw() {
  drawn = true; drawn_at = performance.now();
  const old = state.ended && recorded && recorded.series ? recorded : null, live = state.running && connected();
  loop_keep_s = Math.max(1, 2.5 * period_s());
  for (const [chart, limits] of loops) chart.draw(old ? old.series : series, old ? Infinity : period_s(), limits());
  const window_s = old ? Math.min(WINDOW_S, old.end_s) : WINDOW_S;
  if (old) strips.draw(old.series, old.end_s, [`${plain(old.end_s - window_s)} s`, `${plain(old.end_s)} s into the record`], window_s);
  else strips.draw(series, live ? now_s() : last_sample_s(), live ? ["20 s ago", "now"] : ["", "last samples"]);
  headings(old); gauges();
  const newest = series.get(23); // arrivals at the host, whatever the devices' clocks say
  if (newest && clock) { latencies_ms.push(1000 * (clock_s() - newest.last_t)); if (latencies_ms.length > 5000) latencies_ms.shift(); }
}
function last_sample_s() { return series.has(1) ? series.get(1).last_t : now_s(); }
function headings(old) {
  const one = old ? point(old.point) : null, of = old ? ` – ${old.point} as recorded${one ? `: ${describe(one)}` : ""}` : "";
  for (const [id, text] of [["head-fx", `Force vs. displacement${of}`], ["head-fv", `Force vs. velocity${of}`], ["head-strips", old ? `Record${of}` : "Last 20 s"]]) if (by_id(id).textContent !== text) by_id(id).textContent = text;
}

function take(message) {
  if (message.type === "run") described(message);
  else if (message.type === "state") { if (state.ended && !message.ended) recorded = null; state = message; progress(); confirmations(); buttons(); show_first(); }
  else if (message.type === "results") { results = message.points; matrix(); show_first(); }
  else if (message.type === "events") events(message);
  else if (message.type === "standing") { standing = message; show_standing(); }
  else if (message.type === "answer") answered(message);
  judge();
}
function described(message) {
  if (run && run.ring !== message.ring) { series = new Map(); first_at = 0; window.rigPage.frames = 0; }
  run = message; lamps(); matrix(); by_id("name-of-run").textContent = run.name;
  GAUGES[3].name = run.by_hand ? "Coil current (confirmed)" : "Coil current";
}
function show_first() {
  const shown = Object.entries(results).find(([, one]) => one.file);
  if (state.ended && !state.running && !recorded && shown) { recorded = { point: shown[0] }; say({ do: "recorded", point: shown[0] }); }
}
function answered(message) {
  if (message.do === "clock" && message.ok) { clock_answered(message); return; }
  if (message.do === "explain" && message.ok) { explain(message); return; }
  if (message.do === "recorded" && message.ok) { recorded = { point: message.point }; matrix(); return; }
  if (message.do === "stop") stop_answered(message);
  if (message.do === "words" && message.ok && message.note === by_id("note").value) by_id("note").value = ""; // refused, it stays to be sent again
  answer(message.refused ? (MESSAGES[message.refused] || message.refused) : message.do === "words" ? "Saved." : "");
}

by_id("stop").onclick = stop;
by_id("close").onclick = () => say({ do: "close" });
by_id("start").onclick = () => say({ do: "start", confirmed: [...document.querySelectorAll("#confirm input:checked")].map((tick) => tick.value) });
by_id("pause").onclick = () => say({ do: "pause" });
by_id("set").onclick = () => say({ do: "set", number: Number(by_id("set").dataset.number) });
by_id("lease").onsubmit = (event) => { event.preventDefault(); say({ do: "lease", name: by_id("name").value }); };
by_id("release").onclick = () => say({ do: "release" });
by_id("words").onsubmit = (event) => {
  event.preventDefault();
  const words = {}; if (by_id("specimen").value) words.specimen = by_id("specimen").value; if (by_id("note").value) words.note = by_id("note").value;
  if (Object.keys(words).length) say({ do: "words", ...words });
};
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") close_explanation();
  const typing = /^(INPUT|TEXTAREA)$/.test(event.target.tagName) && event.target.type !== "checkbox";
  if (!typing && !event.repeat && !event.ctrlKey && !event.altKey && !event.metaKey && (event.key === "s" || event.key === "S")) stop();
});

const dark = window.matchMedia("(prefers-color-scheme: dark)");
function theme() { const chosen = localStorage.getItem("rig-page-theme"); document.documentElement.classList.toggle("dark", chosen ? chosen === "dark" : dark.matches); colours.clear(); redraw(); }
dark.addEventListener("change", theme);
window.addEventListener("resize", redraw);
by_id("theme").onclick = () => { localStorage.setItem("rig-page-theme", document.documentElement.classList.contains("dark") ? "light" : "dark"); theme(); };
theme(); connect(); setInterval(look_after, 250);
