// State from the server to the page, commands of the operator to the server.

let series = new Map();
let run = null, state = {}, results = {}, standing = {}, host_now = 0, host_at = 0, first_at = 0, drawn = true, drawn_at = 0;
let selected = []; // by place of its colour: { id, stamp, name, series, end_s } of a finished point, or null
const latencies_ms = [], frames_ms = [];
window.rigPage = { latencies_ms, pointer_ms, frames_ms, get series() { return series; }, get state() { return state; }, get run() { return run; }, get results() { return results; }, get recorded() { return last_selected(); }, get selected() { return selected; }, get charts() { return { loops, strips, trends }; }, frames: 0 };

const MESSAGES = {
  "lease-taken": "Another operator has control.", "not-running": "No campaign is running.", "viewer": "This page is for viewers; viewers can only stop the rig.",
  "no-lease": NO_LEASE, "name-missing": "Type your name first.", "not-reached": "The campaign is not responding.",
  "not-recorded": "The data for this point cannot be read.", "too-many-points": "Too many points were requested at once. Select them again.",
  "unknown-slug": "No explanation is available for this code.",
};

function limit(name) { const value = run && run.limits ? run.limits[name] : null; return typeof value === "number" ? value : Infinity; }
function stroke() { const span = run && run.limits ? run.limits.position_m : null; return Array.isArray(span) ? span : [-Infinity, Infinity]; }
function both_ways(most) { return [-most, most]; }
const GAUGES = [
  { name: "Force", quantity: "force", channel: 1, range: () => both_ways(limit("force_N")) },
  { name: "Displacement", quantity: "displacement", channel: 2, range: stroke },
  { name: "Velocity", quantity: "speed", channel: LOOP_V, aged_by: 2, range: () => both_ways(limit("speed_m_s")) },
  { name: "Coil current", quantity: "current", channel: 10, range: () => both_ways(limit("current_A")) },
  { name: "Coil temperature", quantity: "temperature", channel: 11, one: true, range: () => [0, limit("coil_temperature_degC")] },
  { name: "ECU temperature", quantity: "temperature", channel: 12, one: true, range: () => [0, Infinity] },
  { name: "Supply pressure", quantity: "pressure", channel: 26, one: true, range: () => [0, Infinity] },
];
const OWN_GAUGES = GAUGES.length;
const loops = [
  { chart: new LoopChart(by_id("plot-fx"), "fx", LOOP_X, "displacement", "displacement"), limits: () => ({ x: stroke(), y: both_ways(limit("force_N")) }) },
  { chart: new LoopChart(by_id("plot-fv"), "fv", LOOP_V, "speed", "velocity"), limits: () => ({ x: both_ways(limit("speed_m_s")), y: both_ways(limit("force_N")) }) },
];
function finite(value, otherwise) { return isFinite(value) ? value : otherwise; }
// Half of the range that a lane shows at least: signals at rest are not magnified to noise.
const LANES = [
  { id: "F", name: "F", quantity: "force", channels: [1], least: () => finite(0.02 * limit("force_N"), 5), limits: () => shown_range("force", both_ways(limit("force_N"))) },
  { id: "x", name: "x", quantity: "displacement", channels: [2, 20], least: () => finite(0.01 * (stroke()[1] - stroke()[0]), 0.0005), limits: () => shown_range("displacement", stroke()) },
  { id: "I", name: "I", quantity: "current", channels: [10, 16], least: () => finite(0.05 * limit("current_A"), 0.1), limits: () => both_ways(limit("current_A")) },
  { id: "T", name: "T", quantity: "temperature", channels: [11, 12], least: () => 2, limits: () => [-Infinity, shown("temperature", limit("coil_temperature_degC"))] },
].map((lane) => ({ ...lane, called }));
const strips = new StripChart(by_id("strips"), LANES);
// Auxiliary channels have a unit of their own: temperatures go to the others, the rest has a lane for each unit.
function take_auxiliary(devices) {
  const extra = devices.filter((one) => one.channel >= 3 && one.channel <= 9), lanes = LANES.map((lane) => ({ ...lane, channels: [...lane.channels] }));
  for (const gauge of GAUGES.splice(OWN_GAUGES)) if (gauge.box) gauge.box.remove();
  for (const one of extra) {
    const warm = /^(°C|degC)$/.test(one.unit), quantity = warm ? "temperature" : `auxiliary ${one.unit}`, known = lanes.find((lane) => lane.quantity === quantity);
    if (!warm) QUANTITIES[quantity] = { unit: one.unit, scale: 1, offset: 0, sign: 1 };
    if (known) known.channels.push(one.channel);
    else lanes.push({ id: `auxiliary-${one.channel}`, name: one.name.slice(0, 10), quantity, channels: [one.channel], least: () => 0, limits: () => [-Infinity, Infinity], called });
    GAUGES.push({ name: one.name, quantity, channel: one.channel, one: true, range: () => [-Infinity, Infinity] });
  }
  const key = JSON.stringify(lanes.map((lane) => [lane.quantity, lane.channels]));
  if (key !== lanes_key) { lanes_key = key; strips.set(lanes); }
}
let lanes_key = JSON.stringify(LANES.map((lane) => [lane.quantity, lane.channels]));
const trends = [
  { chart: new TrendChart(by_id("plot-peaks"), "peaks", "force", "F", [{ name: "rebound", colour: "--now" }, { name: "compression", colour: "--second" }]), values: peaks_of },
  { chart: new TrendChart(by_id("plot-heat"), "heat", "temperature", "T", [{ name: "highest", colour: "--now" }, { name: "lowest", colour: "--second" }]), values: (one) => one.coil_degC ? [one.coil_degC[1], one.coil_degC[0]] : null },
];
const wear = [
  { chart: new WearChart(by_id("plot-wear-force"), "wear-force", "force", "F", [{ name: "rebound", colour: "--now" }, { name: "compression", colour: "--second" }]), columns: ["force_max", "force_min"] },
  { chart: new WearChart(by_id("plot-wear-energy"), "wear-energy", "energy", "E", [{ name: "energy", colour: "--now" }]), columns: ["energy"] },
  { chart: new WearChart(by_id("plot-wear-heat"), "wear-heat", "temperature", "T", [{ name: "coil", colour: "--now" }]), columns: ["temperature"] },
];
const trial_charts = {
  errors: new CurveChart(by_id("plot-trial-errors"), "trial-errors", { label: "trial", ticks: (x) => Number.isInteger(x) ? String(x) : "", text: (x) => Number.isInteger(x) ? `trial ${x}` : "" }, "share", "RMS error", [{ name: "error", colour: "--now", dots: true }, { name: "tolerance", colour: "--second", dash: true }], { low: 0 }),
  coherence: new CurveChart(by_id("plot-trial-coherence"), "trial-coherence", { label: "frequency (Hz)", text: (x) => `${plain(x)} Hz` }, "plain", "coherence", [{ name: "coherence", colour: "--now" }, { name: "least", colour: "--second", dash: true }], { low: 0, high: 1.05 }),
  signal: new CurveChart(by_id("plot-trial-signal"), "trial-signal", { label: "time (s)", text: (x) => `${x.toFixed(3)} s` }, "displacement", "displacement", [{ name: "measured", colour: "--now" }, { name: "target", colour: "--second", dash: true }]),
};
function peaks_of(one) { const found = [one.peak_force_rebound_N, one.peak_force_compression_N]; return found.every((value) => typeof value === "number") ? found : null; }
const CHANNEL_NAMES = { 1: "force", 2: "displacement", 20: "displacement (controller)", 10: "current", 16: "current (commanded)", 11: "coil", 12: "ECU" };
function called(channel) { const found = run && run.devices.find((one) => one.channel === channel); return CHANNEL_NAMES[channel] || (found ? found.name : String(channel)); }

function now_s() { return host_now ? host_now + (performance.now() - host_at) / 1000 : 0; }
function clock_s() { return clock ? performance.now() / 1000 + clock.offset_s : now_s(); }
function point(id = state.point) { return run ? run.points.find((one) => one.id === id) : undefined; }
function period_s() { const one = point(); return one && one.repeats !== false && one.frequency_Hz > 0 ? 1 / one.frequency_Hz / (run.device_rate || 1) : 2; }

function frame(buffer) {
  if (kind_of(buffer) === RECORDED) {
    const one = selected.find((each) => each && each.id === id_of(buffer));
    if (one) { one.series = new Map(); one.end_s = read_frame(buffer, one.series, Infinity); drawn_at = 0; redraw(); }
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
  const old = state.ended ? last_selected() : null, live = state.running && connected();
  loop_keep_s = Math.max(1, 2.5 * period_s());
  const overlays = Array.from({ length: OVERLAYS }, (_, place) => selected[place] && selected[place].series ? selected[place] : null);
  const moves = moving(), least = least_shown(moves);
  for (const { chart, limits } of loops) chart.draw(old ? null : { series, period_s: period_s(), moving: moves }, overlays, limits(), { x: chart.quantity === "speed" ? least.speed_m_s : least.displacement_m, y: least.force_N });
  if (old) strips.draw(old.series, old.end_s, Math.min(WINDOW_S, old.end_s), 0);
  else { const end = live ? now_s() : last_sample_s(); strips.draw(series, end, WINDOW_S, end); }
  headings(old); gauges();
  frames_ms.push(performance.now() - drawn_at); if (frames_ms.length > 2000) frames_ms.shift();
  const newest = series.get(23); // arrivals at the host, whatever the devices' clocks say
  if (newest && clock) { latencies_ms.push(1000 * (clock_s() - newest.last_t)); if (latencies_ms.length > 5000) latencies_ms.shift(); }
}
function last_sample_s() { return series.has(1) ? series.get(1).last_t : now_s(); }
function take_display(display) { // units and signs of `[display]`
  for (const [name, { unit, scale, offset, sign }] of Object.entries(display || {})) QUANTITIES[name] = { unit, scale, offset, sign };
  for (const { chart } of [...loops, ...trends, ...wear]) chart.name_axes();
  trial_charts.signal.name_axes();
  strips.name_axes(); rows_of = null; by_id("peak-unit").textContent = `in ${QUANTITIES.force.unit}`;
}
// Half ranges (SI) that the loops show at least: of the running point, at rest those of the plan.
function least_shown(moves) {
  const one = point(), of = (name, most) => {
    const planned = moves && one ? one[name] : run ? run.points.reduce((found, each) => Math.max(found, each[name] || 0), 0) : 0;
    return (moves ? 0.6 : 1) * (planned > 0 ? planned : finite(0.1 * most, 0));
  };
  if (state.ended) return { displacement_m: 0, speed_m_s: 0, force_N: 0 };
  return { displacement_m: of("amplitude_m", stroke()[1]), speed_m_s: of("peak_speed_m_s", limit("speed_m_s")), force_N: moves ? finite(0.02 * limit("force_N"), 5) : of("predicted_force_N", limit("force_N")) };
}
function draw_trends() {
  const points = run ? run.points : [];
  for (const { chart, values } of trends) {
    const found = points.map((one) => ({ id: one.id, described: describe(one), values: results[one.id] ? values(results[one.id]) : null, unfit: Boolean(results[one.id]) && results[one.id].verdict === "invalid" }));
    chart.plot.box.closest("section").hidden = !found.some((one) => one.values);
    chart.draw(found);
  }
}
// The endurance test that was chosen, runs, or ran last; of a current program, the cycles at its highest current are drawn.
let endurance = [], chosen_test = null; // id; null: the one that runs, or ran last
function shown_test() {
  const chosen = endurance.find((test) => test.id === chosen_test); if (chosen) return chosen;
  const one = point(), running = one && endurance.find((test) => test.id === one.endurance_test);
  return running || endurance.filter((test) => test.cycles_run > 0).pop() || endurance[0];
}
function draw_endurance() {
  const test = shown_test();
  by_id("endurance-box").hidden = !test;
  if (!test) { for (const { chart } of wear) chart.plot.box.closest("section").hidden = true; return; }
  const levels = test.trend || [], trend = levels[levels.length - 1] || {}, current = levels.length > 1 && typeof trend.current_A === "number" ? ` at ${trend.current_A.toFixed(2)} A` : "";
  write("endurance-name", `– ${test.id}${test_state(test)}`);
  draw_tests(test);
  by_id("endurance-rules").replaceChildren(...test.rules.map((rule) => element("li", rule.text, rule.reached ? "reached" : rule.value !== null && rule.value >= 0.7 * rule.limit ? "near" : "")));
  for (const { chart, columns } of wear) {
    const head = chart.plot.box.closest("section").querySelector("h2 span"), words = head.dataset.words || (head.dataset.words = head.textContent);
    head.textContent = words + current;
    chart.draw(trend.cycle || [], columns.map((name) => trend[name] || []));
  }
  endurance_cycles();
}
function test_state(test) { return test.ended_by ? ": ended by a stop rule" : test.state === "complete" ? ": complete" : ""; }
function draw_tests(shown) { // of several tests, a button each; another press returns to the test that runs
  const box = by_id("endurance-tests"), focused = box.contains(document.activeElement) ? document.activeElement.dataset.test : null;
  box.hidden = endurance.length < 2;
  box.replaceChildren(...endurance.map((test) => {
    const button = element("button", `${test.id}: ${test.cycles_run.toLocaleString("en-US")} of ${test.cycles_planned.toLocaleString("en-US")}${test_state(test).replace(": ", ", ")}`);
    button.type = "button"; button.dataset.test = test.id; button.setAttribute("aria-pressed", String(test === shown));
    button.onclick = () => { chosen_test = chosen_test === test.id ? null : test.id; cycles_shown = 0; draw_endurance(); };
    return button;
  }));
  if (focused !== null) { const same = [...box.children].find((one) => one.dataset.test === focused); if (same) same.focus(); }
}
function endurance_cycles() { // counted ones, and those of the running block
  const test = shown_test(); if (!test) return;
  const one = point(), own = one && one.endurance_test === test.id && !state.ended;
  const block = own ? Math.max(0, Math.min(one.measured_cycles, state.cycles - one.ramp_in_cycles)) : 0;
  cycles_shown = Math.max(cycles_shown, Math.min(test.cycles_planned, test.cycles_run + Math.floor(block))); // a block that has ended is counted a little later
  const done = cycles_shown, left = test.cycles_planned - done;
  write("endurance-done", `${done.toLocaleString("en-US")} of ${test.cycles_planned.toLocaleString("en-US")} cycles`);
  write("endurance-left", test.ended_by ? "" : `${left.toLocaleString("en-US")} left`);
  const share = 100 * done / test.cycles_planned;
  by_id("endurance-bar").setAttribute("aria-valuenow", share.toFixed(0)); by_id("endurance-bar").firstElementChild.style.width = `${share}%`;
}
let cycles_shown = 0;
let trials = null; // of the signal whose command was iterated last
const OUTCOMES = { converged: "converged", limit: "ended: a limit was reached", "not-coherent": "ended: not coherent", "noise-floor": "ended: noise floor", divergence: "ended: divergence", iterations: "ended: too few iterations" };
function draw_trials() {
  by_id("trials-box").hidden = !trials;
  for (const section of document.querySelectorAll(".trials")) section.hidden = !trials;
  if (!trials) return;
  const { errors, tolerance } = trials, last = errors.length - 1, percent = (value) => `${number(100 * value)} %`;
  write("trials-of", `– ${trials.point}: ${trials.record}${trials.follows === "force" ? " (force target)" : ""}`);
  write("trials-state", last < 0 ? "The response of the machine has been identified." : `Trial ${last}: RMS error ${percent(errors[last])}${tolerance === null ? "" : `, tolerance ${percent(tolerance)}`}${OUTCOMES[trials.outcome] ? `; ${OUTCOMES[trials.outcome]}` : ""}${trials.reason ? `. ${trials.reason}` : ""}`);
  by_id("trials-tolerance").hidden = tolerance === null;
  trial_charts.errors.plot.box.closest("section").hidden = trial_charts.signal.plot.box.closest("section").hidden = last < 0;
  const ends = [-0.5, ...errors.map((_, place) => place), last + 0.5]; // the tolerance is a line across the chart
  trial_charts.errors.draw(ends, [[NaN, ...errors, NaN], ends.map(() => tolerance)]);
  trial_charts.coherence.draw(trials.frequency_Hz, [trials.coherence, trials.frequency_Hz.map(() => trials.least_coherence)]);
  trial_charts.signal.use(...(trials.follows === "force" ? ["force", "force"] : ["displacement", "displacement"]));
  trial_charts.signal.draw(trials.time_s, [trials.measured, trials.target]);
}
function few(ids) { return ids.length > 2 ? `${ids.length} points` : ids.join(", "); }
function headings(old) {
  const shown_ids = selected.filter((each) => each && each.series).map((each) => each.id), one = old ? point(old.id) : null;
  const reading = selected.filter((each) => each && !each.series).map((each) => each.id);
  const of = (!old ? "" : shown_ids.length === 1 ? ` – ${old.id} as recorded${one ? `: ${describe(one)}` : ""}` : ` – ${few(shown_ids)} as recorded`) + (reading.length ? ` – reading ${few(reading)} …` : "");
  for (const [id, text] of [["head-fx", `Force vs. displacement${of}`], ["head-fv", `Force vs. velocity${of}`], ["head-strips", old ? `Last 20 s of ${old.id} as recorded` : strips.kept ? "Zoomed in (not live); reset the zoom to follow the rig" : "Last 20 s"]]) write(id, text);
}

function take(message) {
  if (message.type === "run") described(message);
  else if (message.type === "state") { informed = true; if (state.ended && !message.ended) deselect_all(); state = message; progress(); endurance_cycles(); confirmations(); buttons(); show_first(); show_entered(); if (pause_wanted && (state.ended || (state.paused && state.kind === "paused"))) pause_over(); }
  else if (message.type === "results") { results = message.all === false ? { ...results, ...message.points } : message.points; matrix(); draw_trends(); refresh_selected(); show_first(); }
  else if (message.type === "endurance") { endurance = message.tests; cycles_shown = 0; draw_endurance(); }
  else if (message.type === "iteration") { trials = message.trials; draw_trials(); }
  else if (message.type === "events") events(message);
  else if (message.type === "standing") { standing = message; show_standing(); }
  else if (message.type === "answer") answered(message);
  judge();
}
function described(message) {
  if (run && run.name !== message.name) { trials = null; draw_trials(); endurance = []; chosen_test = null; draw_endurance(); } // another run may have neither
  if (run && run.ring !== message.ring) { series = new Map(); first_at = 0; window.rigPage.frames = 0; deselect_all(); }
  if (JSON.stringify(run && run.display) !== JSON.stringify(message.display)) take_display(message.display);
  if (finished_run && message.name !== finished_run) { finished_run = ""; window.history.replaceState(null, "", with_token("/run")); } // the rig is in use
  run = message; show_rig(); take_auxiliary(run.devices); lamps(); matrix(); draw_trends(); legends(); by_id("name-of-run").textContent = run.name;
  GAUGES[3].name = run.by_hand ? "Coil current (confirmed)" : "Coil current";
}
// Finished points that are shown over each other, each in its colour until it is deselected.
function place_of_point(id) { return selected.findIndex((one) => one && one.id === id); }
function last_selected() { return selected.filter((one) => one && one.series).reduce((last, one) => last && last.number > one.number ? last : one, null); }
let selections = 0;
function select(id) {
  const free = Array.from({ length: OVERLAYS }, (_, place) => place).find((place) => !selected[place]);
  if (free === undefined) { answer(`${OVERLAYS} points are already shown. Deselect a point first.`); return; }
  const one = point(id);
  selected[free] = { id, point: id, number: ++selections, stamp: stamp(id), name: `${id}: ${one ? describe(one) : ""}`, series: null };
  say({ do: "recorded", point: id });
}
function stamp(id) { const one = results[id] || {}; return `${one.file} ${one.verdict}`; }
function choose(id) { // selects a point, or deselects it
  if (!results[id] || !results[id].file) return;
  const place = place_of_point(id); answer("");
  if (place >= 0) selected[place] = null; else select(id);
  show_selection();
}
// The finished points at the current of the one that was selected last, evenly spread where there are many.
function at_one_current() {
  const files = run ? run.points.filter((one) => results[one.id] && results[one.id].file && isFinite(one.current_A)) : [];
  const last = selected.filter(Boolean).reduce((newest, one) => newest && newest.number > one.number ? newest : one, null);
  const one = files.find(({ id }) => last && id === last.id) || files[files.length - 1];
  const found = files.filter(({ current_A }) => Math.abs(current_A - one.current_A) < 0.02), count = Math.min(OVERLAYS, found.length);
  return Array.from({ length: count }, (_, place) => found[count > 1 ? Math.round(place * (found.length - 1) / (count - 1)) : 0]);
}
function offer_overlay() {
  const found = at_one_current(), several = selected.filter(Boolean).length > 1, button = by_id("overlay");
  button.hidden = found.length < 2 && !several;
  button.textContent = several ? "Hide loops" : found.length ? `All loops at ${plain(found[0].current_A)} A` : "";
}
function overlay() {
  const found = at_one_current(), several = selected.filter(Boolean).length > 1;
  selected = []; answer("");
  for (const { id } of several ? [] : found) select(id);
  show_selection();
}
by_id("overlay").onclick = overlay;
function show_selection() { offer_overlay(); for (const one of run ? run.points : []) show_row(one.id, one); one_stop(); strips.reset(); legends(); drawn_at = 0; redraw(); }
function deselect_all() { selected = []; shown_at_end = false; show_selection(); }
function refresh_selected() { // a point that was repeated has another file
  for (const one of selected) if (one && one.stamp !== stamp(one.id)) { one.stamp = stamp(one.id); say({ do: "recorded", point: one.id }); }
}
function show_first() { // at the end: the point that was stopped, else the first one
  const stopped = state.ended && Boolean(state.ended.stopped_by || state.ended.cut_off);
  if (!state.ended || shown_at_end || (!stopped && selected.some(Boolean))) return;
  const files = Object.keys(results).filter((id) => results[id].file), first = stopped ? files[files.length - 1] : files[0];
  if (!first) return;
  shown_at_end = true;
  if (place_of_point(first) < 0) { select(first); show_selection(); }
}
let shown_at_end = false;
let entered = ""; // what the run's files hold; what the operator types here is not replaced
function show_entered() {
  const box = by_id("specimen");
  if (typeof state.entered !== "string" || state.entered === entered || document.activeElement === box || box.value !== entered) return;
  box.value = entered = state.entered;
}
let pause_wanted = ""; // the answer to Pause, shown until the pause has begun or is over
function pause_over() { if (by_id("answer").textContent === pause_wanted) answer(""); pause_wanted = ""; }
function answered(message) {
  if (message.do === "clock" && message.ok) { clock_answered(message); return; }
  if (message.do === "explain" && message.ok) { explain(message); return; }
  if (message.do === "recorded" && message.ok) return; // its frame follows
  if (message.do === "recorded" && place_of_point(message.point) >= 0) { selected[place_of_point(message.point)] = null; show_selection(); }
  if (message.do === "stop") stop_answered(message);
  if (message.do === "start") pause_over();
  if (message.do === "pause" && message.ok) {
    pause_wanted = `Pause requested; the campaign pauses ${preparing() ? "before the first point, once the checks are complete" : "after the current point"}.`;
    answer(pause_wanted); return;
  }
  if (message.do === "words" && message.ok && message.note === by_id("note").value) by_id("note").value = ""; // refused, it stays to be sent again
  answer(message.refused ? (MESSAGES[message.refused] || message.refused) : message.do === "words" ? "Saved." : "", message.refused === "lease-taken" ? for_a_while() : null);
}

for (const button of document.querySelectorAll(".reset")) button.onclick = () => {
  const plots = [...[...loops, ...trends, ...wear].map(({ chart }) => chart), ...Object.values(trial_charts)].map((chart) => chart.plot).concat(strips.lanes.map((lane) => lane.plot));
  for (const plot of plots) if (button.closest("section").contains(plot.box) && plot.view) plot.reset();
};
by_id("close").onclick = () => say({ do: "close" });
by_id("start").onclick = () => say({ do: "start", confirmed: [...document.querySelectorAll("#confirm input:checked")].map((tick) => tick.value) });
by_id("pause").onclick = () => say({ do: "pause" });
by_id("set").onclick = () => say({ do: "set", number: Number(by_id("set").dataset.number) });
by_id("words").onsubmit = (event) => {
  event.preventDefault();
  const words = {}; if (by_id("specimen").value) words.specimen = by_id("specimen").value; if (by_id("note").value) words.note = by_id("note").value;
  if (Object.keys(words).length) say({ do: "words", ...words });
};
by_id("matrix").addEventListener("keydown", (event) => {
  const buttons = [...by_id("matrix").querySelectorAll("button")], at = buttons.indexOf(document.activeElement);
  const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: buttons.length - 1 }[event.key];
  if (to === undefined || !buttons[to]) return;
  event.preventDefault(); buttons[Math.max(0, at)].tabIndex = -1; buttons[to].tabIndex = 0; buttons[to].focus();
});
document.addEventListener("keydown", (event) => {
  if (event.key === "Escape") close_explanation();
});

function repaint() { theme(); colours.clear(); drawn_at = 0; redraw(); draw_trends(); draw_endurance(); draw_trials(); }
dark.addEventListener("change", repaint);
by_id("theme").onclick = () => { other_theme(); repaint(); };
repaint(); connect(); setInterval(look_after, 250);
