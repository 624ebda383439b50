// The bench: choose a matrix, read its plan, start; resume a run; reports. What moves the rig is checked by `rig run` and the station.

let state = {}, standing = {}, bench = {}, runs = [], plan = null, planning = "", asked = null, going = false, sending = false, fresh = "", planned_at = 0;
window.rigBench = { get state() { return state; }, get bench() { return bench; }, get runs() { return runs; }, get plan() { return plan; } };

const WORDS = {
  "lease-taken": "Another operator has control.", "viewer": "This address is for viewers; viewers can only stop the rig.",
  "no-lease": NO_LEASE, "name-missing": "Type your name first.", "not-reached": "The run is not responding.",
  "not-running": "No run is in progress.",
};
const report_of = (name, kind = "report") => with_token(`/${kind}/${encodeURIComponent(name)}`, standing.report_token || token);
function busy() { return Boolean(bench.phase) && bench.phase !== "idle"; }
function frame() {}
function gauges() {}

function take(message) {
  if (message.type === "state") state = message;
  else if (message.type === "bench") { bench = message; show_matrices(); }
  else if (message.type === "history") { runs = message.runs; informed = true; show_history(); line_history(message); }
  else if (message.type === "standing") { standing = message; show_standing(); show_history(); if (bench.matrices) show_matrices(); }
  else if (message.type === "answer") answered(message);
  if (resumed_by_link) resume_by_link(); else remember();
  if (going && !line.on && bench.phase === "running" && state.running && !state.ended) { going = false; location.assign(with_token("/run")); return; }
  if (going && !busy() && bench.outcome && (bench.outcome.refused || bench.outcome.broken)) {
    going = false;
    if (bench.outcome.refused === "plan-changed" && plan) ask_again(); // planned anew; the banner states why
  }
  judge();
}

// Banner: the worst that is known. A run's own page shows more of it.

function opinion() {
  if (stop_asked && !stop_asked.taken && !connected()) return ["bad", "✗", "STOP NOT SENT", "There is no connection to the rig. Stop the rig using its own controls."];
  if (opening()) return ["wait", "…", "CONNECTING", ""];
  if (!connected()) return ["bad", "✗", "NO CONNECTION", "The page is not being served, or the network is down. A run in progress continues. Inspect the rig; start `rig page` again."];
  if (bench.phase === "running") { // the server's word for it: the state may still be that of the run before
    if (state.ended) return ["wait", "…", "STARTING", bench.run];
    if (state.stopping || state.kind === "stopping" || (stop_asked && stop_asked.taken)) return ["bad", "■", "STOPPING", bench.run];
    if (stop_asked) return ["bad", "■", "STOP SENT", "not yet confirmed; be ready to stop the rig using its own controls"];
    const left = typeof state.time_left_s === "number" ? `, ${duration(state.time_left_s)} left` : "";
    return ["good", "▶", state.kind === "paused" ? "PAUSED" : "RUNNING", `${bench.run || "preparing"}: ${state.phase || "starting"}${state.point ? `, ${state.point}` : ""}${left}`];
  }
  if (bench.phase === "evaluating") return ["wait", "…", "EVALUATING", `The run has ended; evaluating it and writing the report of ${bench.run}.`];
  if (bench.phase === "starting") {
    if (stop_asked) return ["bad", "■", stop_asked.taken ? "STOPPING" : "STOP SENT", stop_asked.taken ? "The start is being cancelled." : "not yet confirmed; be ready to stop the rig using its own controls"];
    return ["wait", "…", "STARTING", bench.started ? `${bench.started.title} (${bench.started.by})` : ""];
  }
  const last = runs[0], newer = Boolean(last && bench.started && last.started > bench.started.utc.slice(0, 19)), outcome = newer ? {} : bench.outcome || {};
  if (outcome.broken) return ["bad", "✗", "NOT OK", `${outcome.text} Inspect the rig before continuing.`];
  if (outcome.stopped) return ["bad", "■", "STOPPED", outcome.text];
  if (outcome.refused) return ["bad", "✗", "REFUSED", `${outcome.text} (${outcome.refused})`];
  if (line.on && last && last.ended === "finished" && last.rig_state !== "unknown") return ["wait", "Ⅱ", "PRODUCTION", plan ? plan.matrix : ""];
  return last ? of_last(last) : ["wait", "Ⅱ", "READY", "No runs recorded yet."];
}
const SPECIMEN = { "ok": "OK", "not-ok": "NOT OK", "not-tested": "NOT TESTED" };
function of_last(last) {
  const counts = `${last.valid} of ${last.total} points valid`, name = `Last run (${last.specimen || last.name})`;
  if (last.rig_state === "unknown") return ["bad", "✗", "NOT OK", `RIG STATE UNKNOWN: inspect the rig before continuing. ${last.text}`];
  if (last.ended === "interrupted") return ["bad", "✗", "INTERRUPTED", `${name} ended without a result (process killed or power failure). Inspect the rig before you resume the run.`];
  if (last.ended === "refused") return ["bad", "✗", "REFUSED", `${name}: ${last.text}`];
  if (last.ended === "stopped") return ["bad", "■", "STOPPED", `${name}: ${counts}. ${last.text}`];
  if (last.ended === "finished" && last.valid < last.total) return ["bad", "?", "CHECK", `${name}: ${counts}. ${last.text}`];
  const verdict = SPECIMEN[last.specimen_verdict];
  if (last.ended === "finished" && verdict) return [{ "ok": "good", "not-ok": "bad" }[last.specimen_verdict] || "wait", { "ok": "✓", "not-ok": "✗" }[last.specimen_verdict] || "?", verdict, `${name}: all ${last.total} points valid. Specimen ${verdict}: ${last.specimen_reason}`];
  return ["wait", "Ⅱ", "READY", last.ended === "finished" ? `${name}: all ${last.total} points valid.` : `${name}: ${last.ended}.`];
}
function judge() {
  const found = opinion(), last = runs[0], idle = connected() && !busy();
  if (!connected()) sending = false;
  show_verdict(found);
  document.title = `${found[2]} – ${bench.bench || "MR damper rig"}`;
  by_id("stop").hidden = !["starting", "running"].includes(bench.phase);
  by_id("stop").classList.toggle("sent", Boolean(stop_asked && stop_asked.taken));
  by_id("watch").hidden = !bench.run || bench.phase === "starting"; by_id("watch").href = with_token("/run");
  by_id("watch").textContent = bench.phase === "running" || bench.phase === "evaluating" ? "Watch the run" : "Last run";
  by_id("last-report").hidden = !(idle && last && last.report);
  if (last && by_id("last-report").dataset.name !== last.name + standing.report_token) { by_id("last-report").href = report_of(last.name); by_id("last-report").dataset.name = last.name + standing.report_token; }
  by_id("resume-last").hidden = !(idle && last && last.resumable && standing.role === "operator");
  if (planning) write("plan-empty", `Planning ${planning} … ${duration((performance.now() - planned_at) / 1000)}`);
  by_id("plan-progress").hidden = !planning;
  buttons(); show_running(); line_show();
}

// Control

function show_standing() {
  show_lease(standing); document.querySelector("label[for=name]").hidden = standing.mine;
}
function buttons() {
  const may = standing.mine && connected() && !busy() && !going && !sending, ticks = [...document.querySelectorAll("#confirm input")];
  const set = (id, yes) => { if (by_id(id).disabled === Boolean(yes)) by_id(id).disabled = !yes; };
  const before = stopped_before();
  by_id("choice").hidden = !before || busy();
  if (before) by_id("choice-text").textContent = `The last run of this matrix (specimen ${before.specimen}) was ${before.ended}; ${before.left} of ${before.total} points are left. Do you want to resume it?`;
  set("start", may && plan && plan.feasible && !before && by_id("serial").value.trim() && !serial_wrong());
  for (const made of document.querySelectorAll("#history button")) {
    const needs = made.dataset.kind !== "Resume…", possible = connected() && !busy() && !making && (standing.mine || !needs);
    made.disabled = !possible;
    made.title = possible ? made.dataset.title : busy() ? "possible when the run has ended and its report is written" : making ? "a report is being written" : needs && !standing.mine ? "to write a report, type your name and take control" : "no connection";
  }
  set("resume-now", may && asked && ticks.every((tick) => tick.checked) && (!asked.requalify || by_id("requalified").value.trim()));
  const why = !plan && !asked ? "" : busy() ? "A run is in progress." : !standing.mine ? "To start, type your name and take control." : plan && !asked && !plan.feasible ? "The plan has points outside the limits: correct the matrix file, then choose it again." : before ? "First decide whether to resume the stopped run." : plan && !by_id("serial").value.trim() ? "Enter the serial number of the specimen." : "";
  write("why-not", why);
}

// Matrices and plan

function stopped_before() { // the newest run of the planned matrix, where it was stopped: to be resumed, or not, by choice
  const last = plan && runs.find((run) => run.own && run.matrix === plan.matrix);
  return last && last.resumable && ["stopped", "interrupted"].includes(last.ended) && fresh !== last.name ? last : null;
}

function show_matrices() {
  by_id("bench-name").textContent = `${bench.bench}${bench.simulate ? ` (SIMULATED, ${bench.speed} × real time)` : ""}`; by_id("simulated").hidden = !bench.simulate;
  by_id("folders").textContent = `bench ${bench.file}; matrices in ${bench.folder}; runs in ${bench.out}`;
  const list = by_id("matrices"), shown = JSON.stringify([bench.matrices, plan && plan.matrix, planning, standing.role]);
  by_id("matrices-note").textContent = bench.matrices_note || (bench.matrices.length ? "" : "No matrix files in this folder.");
  if (list.dataset.shown === shown) return;
  const focused = document.activeElement && list.contains(document.activeElement) ? document.activeElement.dataset.name : "";
  list.dataset.shown = shown; list.replaceChildren();
  for (const one of bench.matrices) {
    const item = element("li"), choose = push_button(one.name, `plan ${one.name} on this bench`, () => ask_plan(one.name));
    choose.dataset.name = one.name; choose.setAttribute("aria-pressed", String((planning || (plan && plan.matrix)) === one.name));
    const other = one.remark.startsWith("not a matrix file");
    if (one.remark && !other) choose.className = "wrong";
    choose.disabled = standing.role !== "operator" || other;
    choose.append(element("span", one.remark || (one.serial_number ? `specimen ${one.serial_number}` : ""))); item.append(choose); list.append(item);
    if (one.name === focused) choose.focus();
  }
}
let resumed_by_link = new URLSearchParams(location.search).get("resume"); // from the page of a run that has ended
function resume_by_link() {
  const run = runs.find((one) => one.name === resumed_by_link);
  if (runs.length && !run) resumed_by_link = null;
  if (!run || run.ended === "running" || !bench.bench || standing.role !== "operator" || busy()) return;
  resumed_by_link = null; window.history.replaceState(null, "", with_token("/")); ask_questions(run.name);
}
let remembered = false;
function remember() { // the matrix of before, after a run or a reload
  if (remembered || !bench.matrices || !standing.role || busy()) return;
  remembered = true;
  const name = sessionStorage.getItem("rig-bench-matrix");
  if (standing.role === "operator" && bench.matrices.some((one) => one.name === name && !one.remark)) ask_plan(name);
}
let typed = null; // the serial number of a start that was refused because the plan had changed
function ask_again() { typed = by_id("serial").value; ask_plan(plan.matrix); }
function ask_plan(name) {
  if (planning === name) return;
  asked = null; plan = null; planning = name; planned_at = performance.now(); by_id("resume").hidden = true; by_id("begin").hidden = true;
  sessionStorage.setItem("rig-bench-matrix", name);
  by_id("plan").replaceChildren(); by_id("plan-empty").hidden = false; by_id("plan-empty").textContent = `Planning ${name} …`; by_id("plan-head").textContent = "2. Read the plan, then start"; answer("");
  if (!say({ do: "plan", matrix: name })) planning = "";
  show_matrices(); buttons();
}
function show_plan(message) {
  if (message.of !== planning) return; // another matrix was chosen meanwhile, or a run is being resumed
  planning = "";
  if (message.refused) {
    by_id("plan-empty").hidden = false; by_id("plan-empty").textContent = "This matrix cannot be planned:";
    by_id("plan").replaceChildren(...words_of(message).split("\n").map((line) => element("p", line, "poor"))); show_matrices(); return;
  }
  plan = message; by_id("plan-empty").hidden = true; by_id("begin").hidden = false;
  by_id("plan-head").textContent = `2. Plan of ${message.matrix}`;
  by_id("plan").replaceChildren(...message.blocks.filter((block) => block.text !== "").map(show_block)); by_id("plan").scrollTop = 0; enter_serial(message.serial_number);
  show_matrices(); line_show();
  if (plan.line && plan.feasible && sessionStorage.getItem("rig-line") === plan.matrix && !line.on) line_open(true); // after a reload
  else if (plan.line && line.on) say({ do: "prepare" }); // the view was opened before the matrix
}
function enter_serial(proposed) { // never that of a specimen that was tested before: the next one would be recorded under its name
  const tested = runs.some((run) => run.specimen === proposed || run.matrix === plan.matrix);
  by_id("serial").value = typed !== null ? typed : tested ? "" : proposed;
  by_id("serial").placeholder = tested ? "required" : ""; typed = null; show_serial();
}
function show_serial() { // the plan states what would be started, and the hint what there is of this specimen
  const serial = by_id("serial").value.trim(), before = runs.find((run) => run.specimen === serial && serial);
  const count = runs.filter((run) => run.specimen === serial).length, hint = before ? `${serial} already has ${count === 1 ? "a run" : `${count} runs`} on file; the last one: ${local(before.started)}, ${before.ended}, ${before.valid} of ${before.total} points valid.` : "";
  const wrong = serial_wrong();
  write("serial-hint", wrong ? `This serial number is not possible. Expected: ${by_id("serial").title}.` : hint);
  by_id("serial").setAttribute("aria-invalid", String(wrong)); by_id("serial-hint").classList.toggle("poor", wrong);
  const named = document.querySelector("#plan .serial"); if (named) named.textContent = serial || "(no serial number)";
}
function serial_wrong() { const text = by_id("serial").value.trim(); return Boolean(text) && !new RegExp(`^(?:${by_id("serial").pattern})$`).test(text); }
function show_block(block) {
  if (block.kind === "text" && block.text.startsWith(`${plan.serial_number} on `)) {
    const line = element("p"); line.append(element("span", "", "serial"), block.text.slice(plan.serial_number.length)); return line;
  }
  if (block.kind !== "table") return element("p", block.text, block.kind === "note" ? block.level : "");
  const kind = (column) => [column && column.numeric ? "numeric" : "", column && ["accel.", "heat"].includes(column.title) ? "minor" : ""].join(" ").trim(); // a phone leaves out what is minor
  const made = element("table"), head = element("tr"), body = element("tbody"), top = element("thead");
  for (const column of block.columns) head.append(element("th", `${column.title}${column.unit ? ` / ${column.unit}` : ""}`, kind(column)));
  for (const row of block.rows) {
    const line = element("tr", undefined, row.level);
    row.cells.forEach((cell, index) => line.append(element("td", cell, kind(block.columns[index]))));
    body.append(line);
  }
  top.append(head); made.append(top, body); return made;
}

// Resuming

function ask_questions(name) { answer(""); planning = ""; remembered = true; if (say({ do: "questions", run: name })) answer("Reading the causes of the stop …"); }
function show_questions(message) {
  asked = message; plan = null; by_id("begin").hidden = true; by_id("plan").replaceChildren(); by_id("plan-empty").hidden = true;
  by_id("plan-head").textContent = `Resume ${message.run}`; by_id("resume").hidden = false; by_id("requalified-box").hidden = !message.requalify; by_id("requalified").value = "";
  by_id("resume-head").textContent = `Specimen ${message.specimen}: ${message.left} of ${message.total} points left. All checks are repeated; valid points are kept.${message.stops.length ? " Confirm the following:" : ""}`;
  by_id("left-out").textContent = message.left_out.length ? `Options of the first simulated rig that are not reused: ${message.left_out.join(", ")}.` : "";
  by_id("confirm").replaceChildren();
  for (const one of message.stops) {
    const label = element("label"), tick = element("input"); tick.type = "checkbox"; tick.value = one.slug; tick.onchange = buttons;
    label.append(tick, element("span", words_of_stop(one))); by_id("confirm").append(label);
  }
  show_matrices(); by_id("plan-box").scrollIntoView({ block: "nearest" }); (document.querySelector("#confirm input") || by_id("resume-now")).focus(); buttons();
}
function words_of_stop(one) {
  const time = local(one.utc.slice(0, 19)) || one.utc;
  if (one.requested) return `${time}: ${one.detail || "Stop was requested"}. The reason for this stop no longer exists; it is safe to move the rig again.`;
  return `${time}, ${one.slug} (${one.stop}): ${one.detail || "no detail"}. I have checked and, if necessary, fixed: ${one.check || one.look_at}.`;
}
function cancel() { asked = null; by_id("resume").hidden = true; by_id("plan-empty").hidden = false; by_id("plan-empty").textContent = "Choose a matrix to see its plan on this bench."; by_id("plan-head").textContent = "2. Read the plan, then start"; buttons(); }

// History

const ENDINGS = { finished: "finished", stopped: "stopped", refused: "refused", interrupted: "interrupted", running: "running", imported: "imported" };
function local(utc) { return utc.length === 10 ? utc : Number.isFinite(Date.parse(`${utc}Z`)) ? new Date(`${utc}Z`).toLocaleString("sv-SE").slice(0, 16) : ""; }
function show_history() {
  const body = by_id("history").tBodies[0], focused = document.activeElement && body.contains(document.activeElement) ? document.activeElement.dataset.name : "";
  body.replaceChildren(); show_serial();
  if (!runs.length) { const cell = element("td", "No runs yet.", "none"); cell.colSpan = 6; const row = element("tr"); row.append(cell); body.append(row); }
  for (const run of runs) {
    const row = element("tr"), good = run.ended === "finished" && run.valid === run.total && ["", "ok"].includes(run.specimen_verdict), acts = element("td", undefined, "acts");
    if (!good && !["running", "imported"].includes(run.ended)) row.className = "bad";
    const text = `${ENDINGS[run.ended] || run.ended}${run.slug ? `: ${run.slug}` : ""}${run.rig_state === "unknown" ? "; RIG STATE UNKNOWN" : ""}${run.resumed ? `; resumed${run.resumed > 1 ? ` ${run.resumed} times` : ""}` : ""}`;
    const points = element("td", points_of(run)); if (run.ended === "running") points.id = "running-points";
    const result = element("td"), words = element("span", text); if (run.ended === "running") { words.id = "running-text"; words.dataset.text = text; }
    result.append(element("span", `${good ? "✓" : run.ended === "running" ? "▶" : "✗"} `, "mark"), words); for (const more of [run.text, SPECIMEN[run.specimen_verdict] ? `specimen ${SPECIMEN[run.specimen_verdict]}: ${run.specimen_reason}` : ""]) if (more) result.append(element("div", more.length > 160 ? `${more.slice(0, 160)} …` : more, "small"));
    if (run.report) { const link = element("a", "Report"); link.href = report_of(run.name); link.target = "_blank"; link.rel = "noopener noreferrer"; link.setAttribute("aria-label", `Report of ${run.name}`); acts.append(link); }
    if (run.pdf) { const link = element("a", "PDF"); link.href = report_of(run.name, "pdf"); link.rel = "noopener noreferrer"; link.setAttribute("aria-label", `Report of ${run.name} as PDF`); acts.append(link); }
    if (standing.role === "operator") {
      if (!run.report && run.recorded && run.ended !== "running") acts.append(act("Make report", run, () => make_report(run, false)));
      if (run.report && !run.pdf && run.recorded) acts.append(act("Make PDF", run, () => make_report(run, true)));
      if (run.resumable) acts.append(act("Resume…", run, () => ask_questions(run.name)));
      const writes = making && making.run === run.name;
      if (writes) acts.append(element("progress"));
      const note = writes ? `The ${making.kind} is being written …` : not_made && not_made.run === run.name ? not_made.text : "";
      if (note) { const told = element("div", note, writes ? "small" : "small poor"); told.setAttribute("role", "status"); acts.append(told); }
    }
    const name = element("td", undefined, "small"), specimen = element("td", `${run.specimen}${run.simulated ? " (simulated)" : ""}`);
    if (run.matrix) specimen.append(element("div", run.matrix, "small"));
    name.append(view_of(run));
    if (run.operator) name.append(element("div", `operator: ${run.operator}`));
    row.append(element("td", local(run.started)), specimen, result, points, name, acts);
    body.append(row);
  }
  buttons(); show_running();
  if (focused) { const again = body.querySelector(`[data-name="${CSS.escape(focused)}"]`); if (again) again.focus(); }
}
let making = null, not_made = null; // a report or PDF that is being written, and why the last one was not: { run, kind } and { run, text }
function make_report(run, pdf) {
  not_made = null; making = { run: run.name, kind: pdf ? "PDF" : "report" };
  if (!say({ do: "make-report", run: run.name, pdf })) report_made({ refused: "not-reached", text: "Not sent: there is no connection to the page." });
  show_history(); buttons();
}
function report_made(message) {
  if (making && message.refused) not_made = { run: making.run, text: `The ${making.kind} was not written: ${words_of(message)}` };
  making = null; show_history(); buttons();
}
function points_of(run) { return `${run.valid} of ${run.total} valid${run.suspect ? `, ${run.suspect} suspect` : ""}${run.invalid ? `, ${run.invalid} invalid` : ""}`; }
function show_running() { // the row of the run that is in progress follows its state
  const run = runs.find((one) => one.ended === "running");
  if (!run || !by_id("running-text")) return;
  const own = typeof state.valid === "number" && (state.campaign || "").endsWith(`/${run.name}`), now = own ? { ...run, ...state_counts() } : run;
  write("running-points", points_of(now));
  write("running-text", bench.phase === "evaluating" || (own && state.ended) ? by_id("running-text").dataset.text.replace("running", "evaluating") : by_id("running-text").dataset.text);
}
function state_counts() { return { valid: state.valid, suspect: state.suspect, invalid: state.invalid }; }
function view_of(run) { const made = element("a", run.name, "view"); made.title = `Show ${run.name}`; made.href = `${with_token("/run")}&run=${encodeURIComponent(run.name)}`; made.dataset.name = `view ${run.name}`; return made; }
function act(text, run, press) { const made = push_button(text, `${text} ${run.name}`, press); made.dataset.name = `${text} ${run.name}`; made.dataset.kind = text; made.dataset.title = made.title; made.setAttribute("aria-label", `${text} ${run.name}`); return made; }

function words_of(message) { return message.text || WORDS[message.refused] || message.refused; }
function answered(message) {
  if (message.do === "clock" && message.ok) { clock_answered(message); return; }
  if (message.do === "stop") stop_answered(message);
  if (message.do === "begin" || message.do === "resume") sending = false;
  if (message.do === "plan") { show_plan(message); return; }
  if (message.do === "prepare") return;
  if (message.do === "questions" && message.ok) { answer(""); show_questions(message); return; }
  if (message.do === "begin" && line_answered(message)) { if (message.refused === "not-planned" && plan) ask_again(); return; }
  if ((message.do === "begin" || message.do === "resume") && message.ok) { going = true; answer(""); if (asked) cancel(); return; }
  if (message.do === "begin" && message.refused === "not-planned" && plan) ask_again();
  if (message.do === "make-report") report_made(message);
  const at_least = for_a_while(), passing = ["already-running", "still-analysing"].includes(message.refused) ? () => busy() || at_least() : message.refused === "lease-taken" ? at_least : null;
  if (message.do === "make-report" && message.refused) return; // stated beside the button
  answer(message.refused ? words_of(message) : message.do === "make-report" ? `The ${message.pdf ? "PDF" : "report"} of ${message.run} is ready.` : "", passing);
}

by_id("resume-last").onclick = () => ask_questions(runs[0].name);
by_id("cancel").onclick = cancel;
by_id("choose-resume").onclick = () => { const before = stopped_before(); if (before) ask_questions(before.name); };
by_id("choose-new").onclick = () => { const before = stopped_before(); if (before) fresh = before.name; buttons(); by_id("serial").focus(); };
by_id("serial").oninput = () => { show_serial(); buttons(); };
by_id("requalified").oninput = buttons;
by_id("begin").onsubmit = (event) => { event.preventDefault(); if (plan && !by_id("start").disabled) { stop_asked = null; sending = say({ do: "begin", matrix: plan.matrix, planned: plan.planned, serial_number: by_id("serial").value.trim(), specimen: by_id("specimen").value, note: by_id("note").value }); buttons(); } };
by_id("resume").onsubmit = (event) => { event.preventDefault(); if (asked && !by_id("resume-now").disabled) { stop_asked = null; sending = say({ do: "resume", run: asked.run, confirmed: [...document.querySelectorAll("#confirm input:checked")].map((tick) => tick.value), requalified: by_id("requalified").value }); buttons(); } };
dark.addEventListener("change", theme);
by_id("theme").onclick = () => { other_theme(); theme(); };
theme(); connect(); setInterval(look_after, 250);
