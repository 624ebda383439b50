// Everything on the page except charts and banner, from the server's messages. Text is always set as text, never as markup.

function describe(one) {
  if (one.described) return one.described;
  return `${one.waveform} ${plain(1000 * one.amplitude_m)} mm, ${plain(one.frequency_Hz)} Hz, ${plain(one.current_A)} A`;
}
function question(asked) { return asked.current_A ? `set the supply to ${asked.current_A.toFixed(2)} A, then confirm` : "set the supply to 0 A, switch its output off, then confirm"; }

function show_rig() { // whether it is simulated, and its name
  const simulated = run && run.name ? Boolean(run.simulated) : Boolean(standing.simulate), name = standing.bench || (run ? run.bench : "") || "";
  by_id("simulated").hidden = !simulated; by_id("bench-name").textContent = simulated && name === "simulated rig" ? "" : name;
}

function evaluating() { return Boolean(standing.bench && state.running && state.ended && connected()); }
function progress() {
  const one = point(), total = run ? run.points.length : 0, done = Object.values(results).filter((each) => each.verdict !== "not run" && !each.stopped).length;
  by_id("point").textContent = one && !state.ended ? `${one.id}: ${describe(one)}` : state.ended ? "ended" : "–";
  // The cycle counter of the controller includes the ramps; the test is the part between them.
  const measured = one ? Math.max(0, Math.min(Math.round(one.measured_cycles ?? one.cycles), Math.round(state.cycles - (one.ramp_in_cycles ?? 0)))) : 0;
  by_id("phase").textContent = state.ended ? (evaluating() ? "the results are being evaluated" : "") : `${state.phase || ""}${one && state.cycles ? `, cycle ${measured} of ${Math.round(one.measured_cycles ?? one.cycles)}` : ""}`;
  by_id("left").textContent = state.ended || !state.running || state.stopping || state.kind === "stopping" ? "" : typeof state.time_left_s === "number" ? `${duration(state.time_left_s)} left` : "";
  const share = total ? 100 * Math.min(1, (done + (one && one.cycles && !results[one.id] ? Math.min(1, state.cycles / one.cycles) : 0)) / total) : 0;
  by_id("done").style.width = `${share}%`;
  by_id("bar").setAttribute("aria-valuenow", share.toFixed(0));
  const running = state.ended ? null : rows.get(state.point) || null;
  if (running !== running_row) { if (running_row) running_row.classList.remove("running"); if (running) { running.classList.add("running"); follow(running); } running_row = running; }
}

function follow(row) { // the list shows the running point, except while the list is in use
  const list = by_id("matrix");
  if (list.matches(":hover") || list.contains(document.activeElement)) return;
  const top = row.getBoundingClientRect().top - list.getBoundingClientRect().top;
  if (top < 0 || top + row.offsetHeight > list.clientHeight) list.scrollTop += top - list.clientHeight / 3;
}

function matrix() {
  const points = run ? run.points : [];
  if (rows_of !== points) { // a new plan; results change rows only
    rows_of = points; rows.clear(); by_id("matrix").replaceChildren(); running_row = null;
    by_id("matrix-box").style.setProperty("--id-width", `min(calc(${points.reduce((most, one) => Math.max(most, one.id.length), 4)}ch + 1.5rem), 40%)`);
    for (const one of points) { const row = element("li"); row.dataset.id = one.id; rows.set(one.id, row); by_id("matrix").append(row); }
  }
  for (const one of points) show_row(one.id, one);
  offer_overlay();
  one_stop();
  const judged = Object.entries(results).filter(([, one]) => one.verdict !== "not run"), valid = points_that_are("valid").length, stopped = judged.filter(([, one]) => one.stopped).length;
  by_id("count").textContent = points.length ? `– ${valid} valid, ${judged.length - stopped} of ${points.length} done${stopped ? `, ${stopped} stopped` : ""}; specimen ${run.specimen}` : "";
  const [last, found] = judged.pop() || [];
  if (last) {
    const one = points.find((each) => each.id === last);
    by_id("last").textContent = `Last result: ${last} ${found.verdict}${one ? ` (${describe(one)})` : ""}${found.reasons && found.reasons.length ? `: ${found.reasons.join("; ")}` : ""}`;
  } else by_id("last").textContent = "";
  progress();
}
const rows = new Map();
let rows_of = null, running_row = null;
function show_row(id, one = point(id)) {
  const row = rows.get(id), judged = results[id] || {}, place = place_of_point(id), wanted = JSON.stringify([judged, place, one.described]);
  if (!row || row.dataset.shown === wanted) return;
  const focused = row.contains(document.activeElement), verdict = judged.verdict || "", mark = { valid: "✓", suspect: "?", invalid: "✗" }[verdict] || "·";
  row.dataset.shown = wanted; row.className = `row ${verdict.replace(" ", "-")}${row === running_row ? " running" : ""}`; row.title = `${id}: ${describe(one)}${verdict ? `, ${verdict}` : ""}`;
  const peaks = peaks_of(judged), motion = element("span", describe(one).replace(/ A$/, "\u00a0A"), "motion"), head = element("b", `${mark} ${id}`);
  head.setAttribute("aria-label", `${id} ${verdict}`);
  row.replaceChildren(head, motion, element("span", peaks ? peak_text(peaks[1]) : "", "force"), element("span", peaks ? peak_text(peaks[0]) : "", "force"));
  if (judged.file) {
    const show = push_button("loops", `show or hide the loops of ${id}`, () => choose(id));
    show.setAttribute("aria-label", `loops of ${id}`); show.setAttribute("aria-pressed", String(place >= 0));
    if (place >= 0) show.style.background = `var(--overlay-${place + 1})`;
    show.tabIndex = -1; row.append(show);
    if (focused) show.focus();
  }
  for (const reason of judged.reasons || []) row.append(element("div", reason, "reason"));
}
function one_stop() { // the list is one stop for Tab; arrow keys move within it
  const list = by_id("matrix");
  if (!list.querySelector('button[tabindex="0"]')) { const first = list.querySelector("button"); if (first) first.tabIndex = 0; }
}

function legends() {
  const chip = (name, kind) => { const item = element("li"), swatch = element("i", undefined, `swatch ${kind}`); item.append(swatch, element("span", name)); return [item, swatch]; };
  const list = by_id("legend-loops"), strip = by_id("legend-strips"), bounded = isFinite(limit("force_N"));
  list.replaceChildren(); strip.replaceChildren();
  if (!state.ended) for (const [name, kind] of [["this cycle", "now"], ["previous cycle", "before"], ["now", "dot"]]) list.append(chip(name, kind)[0]);
  selected.forEach((one, place) => { if (one) { const [item, swatch] = chip(one.name, ""); swatch.style.borderColor = `var(--overlay-${place + 1})`; list.append(item); } });
  if (bounded) list.append(chip("outside limits", "limits")[0]);
  if (QUANTITIES.force.sign < 0) list.append(element("li", "compression is positive"));
  for (const [name, kind] of [["force, displacement, current, coil", "now"], ["displacement from the controller, commanded current, ECU", "dashed"]]) strip.append(chip(name, kind)[0]);
}

function lamps() {
  const list = by_id("lamps"); list.replaceChildren();
  for (const one of [...run.devices, { name: "rig software", channel: -1, stale_after_s: 2 }]) {
    const item = element("li"); item.dataset.channel = one.channel; item.dataset.stale = one.stale_after_s;
    item.append(element("span", "·", "mark"), element("span", one.name), element("span", "", "age"));
    list.append(item);
  }
}
function ages() {
  const live = connected() && state.running && !state.ended && state.kind !== "ended";
  for (const item of document.querySelectorAll("#lamps li")) {
    const channel = Number(item.dataset.channel), last = channel < 0 ? (state.host_ns || 0) * 1e-9 : series.has(channel) ? series.get(channel).last_t : 0;
    const known = last > 0 && host_now > 0, age = Math.max(0, now_s() - last), over = age > allowed_s(Number(item.dataset.stale));
    const kind = !known || !live ? "" : over ? "bad" : "good";
    if (item.className !== kind) { item.className = kind; item.children[0].textContent = kind === "good" ? "✓" : kind === "bad" ? "✗" : "·"; }
    const text = !live ? (state.running && !state.ended && state.kind !== "ended" ? "unknown" : "ended") : !known ? "no data yet" : age < 1 ? "< 1 s old" : `${age.toFixed(age < 10 ? 1 : 0)} s old`;
    if (item.children[2].textContent !== text) item.children[2].textContent = text;
  }
}

const OLD_VALUE_S = 2.5;
function gauges() {
  for (const gauge of GAUGES) {
    const one = series.get(gauge.channel);
    if (!one || !isFinite(one.last)) continue;
    if (!gauge.box) make_gauge(gauge);
    const { unit } = QUANTITIES[gauge.quantity], value = shown(gauge.quantity, one.last), [low, high] = shown_range(gauge.quantity, gauge.range()), age = age_s(gauge.aged_by || gauge.channel);
    const bounded = isFinite(low) && isFinite(high) && high > low, live = connected() && state.running && age < OLD_VALUE_S;
    const over = live && bounded && (value < low || value > high);
    gauge.text.textContent = live ? `${over ? "✗ outside limits: " : ""}${number(value)} ${unit}` : "–";
    gauge.track.hidden = !bounded || !live;
    const limits = !bounded ? "" : gauge.one ? `limit ${plain(high)} ${unit}` : high === -low ? `limits ±${plain(high)} ${unit}` : `limits ${plain(low)} to ${plain(high)} ${unit}`;
    gauge.note.textContent = live ? limits : `last ${number(value)} ${unit}${state.running ? `, ${duration(age)} ago` : ""}`;
    gauge.hand.style.left = bounded ? `${Math.min(100, Math.max(0, 100 * (value - low) / (high - low)))}%` : "0";
    gauge.box.classList.toggle("over", over);
  }
}
function make_gauge(gauge) {
  gauge.box = element("div", undefined, gauge.one ? "gauge one" : "gauge");
  gauge.value = element("div", undefined, "value"); gauge.text = element("b"); gauge.name_box = element("span", gauge.name);
  gauge.value.append(gauge.name_box, gauge.text);
  gauge.track = element("div", undefined, "track"); gauge.hand = element("div", undefined, "hand"); gauge.track.append(gauge.hand);
  gauge.note = element("div", "", "small"); gauge.box.append(gauge.value, gauge.track, gauge.note);
  const after = GAUGES.slice(GAUGES.indexOf(gauge) + 1).find((each) => each.box);
  by_id("gauges").insertBefore(gauge.box, after ? after.box : null);
}

function events(message) {
  const list = by_id("events");
  if (message.all) list.replaceChildren();
  for (const one of message.events) {
    if (one.instead_of) { const before = list.querySelector(`[data-number="${one.instead_of}"]`); if (before) before.remove(); }
    const item = element("li", undefined, one.level); item.dataset.number = one.number;
    const mark = { error: "✗ ", warning: "! " }[one.level] || "";
    item.append(element("span", `${mark}${one.utc.slice(11, 19)} `));
    if (one.slug) item.append(push_button(one.slug, "explain this code", () => say({ do: "explain", slug: one.slug })));
    item.append(element("span", ` ${one.by ? `${one.by}: ` : ""}${one.text}`));
    if (one.slug && one.level !== "info") {
      const acknowledge = push_button("Acknowledge", "record that you have seen this event", () => { if (say({ do: "words", acknowledged: one.slug }) && standing.mine) acknowledge.disabled = true; });
      acknowledge.className = "seen";
      item.append(" ", acknowledge);
    }
    list.prepend(item);
  }
  while (list.children.length > 200) list.lastChild.remove();
}
let explained_from = null;
function explain(message) {
  const box = by_id("explanation"); box.replaceChildren(element("b", message.slug), element("p", message.means));
  if (message.done) box.append(element("p", message.done));
  const look = element("ul"); for (const text of message.look_at) look.append(element("li", `• check: ${text}`));
  const close = push_button("Close", "return to the events (Esc)", close_explanation);
  if (box.hidden) explained_from = document.activeElement;
  box.append(look, element("p", message.resume || ""), close); box.hidden = false; close.focus();
}
function close_explanation() {
  const box = by_id("explanation"); if (box.hidden) return;
  box.hidden = true; if (explained_from && explained_from.isConnected) explained_from.focus();
}

function show_standing() {
  const mine = standing.mine, viewer = standing.role === "viewer", here = document.activeElement, move = mine && (here === by_id("take") || here === by_id("name"));
  show_lease(standing); by_id("words").hidden = viewer; show_rig();
  by_id("to-bench").hidden = !standing.bench; by_id("to-report").hidden = !standing.report || !state.ended;
  by_id("to-bench").href = with_token("/");
  if (standing.report) by_id("to-report").href = with_token(`/report/${encodeURIComponent(standing.report)}`, standing.report_token);
  buttons();
  if (move) (["set", "start", "pause"].map(by_id).find((one) => !one.disabled && one.offsetParent) || by_id("release")).focus(); // keep the keyboard focus on the active control
}
function confirmations() {
  const box = by_id("confirm"), stops = state.held ? state.confirm || [] : [], wanted = stops.map((one) => one.slug).join(" ");
  if (box.dataset.slugs === wanted) return;
  box.dataset.slugs = wanted; box.replaceChildren();
  for (const one of stops) {
    const label = element("label"), tick = element("input"); tick.type = "checkbox"; tick.value = one.slug; tick.onchange = buttons;
    label.append(tick, element("span", `${one.slug} (${one.stop}): ${one.detail || ""} – checked and fixed: ${one.look_at || ""}`)); box.append(label);
  }
}
function buttons() {
  const ticks = [...document.querySelectorAll("#confirm input")], asked = state.ended ? null : state.asked;
  const may = standing.mine && state.running && !state.ended && connected();
  const pressable = { start: may && (state.held || state.paused) && ticks.every((tick) => tick.checked), pause: may && !state.held && !state.paused, keep: may, set: may && asked };
  for (const [id, yes] of Object.entries(pressable)) if (by_id(id).disabled === Boolean(yes)) by_id(id).disabled = !yes;
  by_id("start").textContent = state.paused && !state.held ? "Resume" : "Start";
  by_id("ask").hidden = !asked;
  if (asked) { by_id("question").textContent = `To do: ${question(asked)}.`; by_id("set").textContent = asked.current_A ? `${asked.current_A.toFixed(2)} A is set` : "0 A is set and the output is off"; by_id("set").dataset.number = asked.number; }
  for (const id of ["start", "pause", "take", "keep", "set"]) by_id(id).hidden = standing.role === "viewer" || (id === "take" && standing.mine);
}
