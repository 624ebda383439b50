// Text of the banner: the worst known state, and nothing good that is not confirmed by current data.

const STATION_STARTS_S = 30; // the rig software waits for the station process; no device is connected yet
const NEEDED = [23, 1, 2]; // controller, load cell, displacement: without them the state of the machine is unknown

function devices_late() {
  if (!run || !state.running || !host_now) return [];
  if (state.kind === "ended") return []; // the devices are disconnected while the result is written
  const late = run.devices.filter((one) => series.has(one.channel) && age_s(one.channel) > allowed_s(one.stale_after_s)).map((one) => one.name);
  const missed = run.devices.filter((one) => NEEDED.includes(one.channel) && !series.has(one.channel) && first_frame_s() > allowed_s(one.stale_after_s) + 1);
  if (moving()) late.push(...missed.map((one) => one.name));
  if (state.host_ns && now_s() - state.host_ns * 1e-9 > (heard_of() ? 2 : STATION_STARTS_S)) late.push("rig software");
  return late;
}
function allowed_s(stale_after_s) { return Math.max(stale_after_s, 0.2) + 0.15; }
function age_s(channel) { return now_s() - series.get(channel).last_t; }
function first_frame_s() { return first_at ? (performance.now() - first_at) / 1000 : 0; }
function moving() { return state.kind === "moving"; }
function heard_of() { return Boolean(run) && run.devices.some((one) => series.has(one.channel)); }
function preparing() { return !heard_of() || state.kind === "preparing"; } // nothing is proven yet
// What the controller says of the hydraulics (drivers/roles.py); a rod under pressure may move at any moment.
function hydraulics() {
  const value = series.has(23) && age_s(23) < 2 ? series.get(23).last : NaN;
  return value === 0 ? "off" : value === 1 ? "at low pressure" : value >= 2 && value <= 6 ? "on" : "";
}
function of_a_pause() {
  const known = hydraulics(), pressed = standing.role === "viewer" || !standing.mine ? "the operator presses Resume" : "you press Resume";
  return `${known ? `The hydraulics are ${known}` : "The hydraulics may be on"}; the rod may move when ${pressed}`;
}
function points_that_are(verdict) { return Object.entries(results).filter(([, one]) => one.verdict === verdict).map(([id]) => id); }

function opinion() {
  if (state.ended) return of_the_end(state.ended, connected() ? "" : standing.bench ? " (There is no connection to the page; this is the state when the connection was lost.)" : " (The page has been closed; this is the final state of the campaign.)");
  if (stop_asked && !stop_asked.taken && !connected()) return ["bad", "✗", "STOP NOT SENT", "There is no connection to the rig. Stop the rig using its own controls."];
  if (opening()) return ["wait", "…", "CONNECTING", ""];
  if (!connected()) return ["bad", "✗", "NO CONNECTION", run ? "The displayed values are out of date. Inspect the rig and, if necessary, stop the rig using its own controls." : "There is no connection to the rig. Inspect the rig and, if necessary, stop the rig using its own controls."];
  if (!state.running && state.kind === undefined) return ["wait", "…", "WAITING", "waiting for the campaign"];
  if (!state.running) return ["bad", "✗", "NOT OK", "The rig software stopped unexpectedly (process killed or power failure). The station stops the rig. Inspect the rig."];
  if (state.kind === "stopping" || state.stopping || (stop_asked && stop_asked.taken)) return of_a_stop();
  if (stop_asked) return ["bad", "■", "STOP SENT", "not yet confirmed; be ready to stop the rig using its own controls"];
  const late = devices_late(), invalid = points_that_are("invalid"), suspect = points_that_are("suspect");
  const todo = state.asked ? `; to do: ${question(state.asked)}` : state.held ? "; waiting for Start" : state.kind === "paused" ? "; paused" : "";
  if (late.length) return ["bad", "✗", "NOT OK", `no new data from: ${late.join(", ")}${todo}`];
  if (invalid.length) return ["bad", "✗", "NOT OK", `invalid points: ${invalid.join(", ")}${todo}`];
  const doubt = suspect.length ? `; suspect points: ${suspect.join(", ")}` : "";
  if (state.asked) return ["wait", "?", "SET CURRENT", `${question(state.asked)}${doubt}`];
  if (state.held) return ["wait", "Ⅱ", "READY", standing.mine ? "press Start to begin" : standing.role === "viewer" || standing.holder ? "waiting for Start" : "to begin, take control, then press Start"];
  if (state.kind === "paused") return ["wait", "Ⅱ", "PAUSED", `${of_a_pause()}${doubt}`];
  const what = `${state.phase || ""}${state.paused ? `; the campaign will pause ${preparing() ? "before the first point" : "after this point"}` : ""}`;
  if (suspect.length) return ["bad", "?", "CHECK", `suspect points: ${suspect.join(", ")}; ${what}`];
  return preparing() ? ["wait", "…", "STARTING", what] : ["good", "✓", "OK", what];
}

function of_a_stop() { // until the campaign has ended, or moves again
  if (state.asked) return ["bad", "?", "SET CURRENT", `stopped; ${question(state.asked)}`];
  const fading = run && run.by_hand ? "motion ramps down; the current remains on until the operator sets it to 0 A" : "coil to 0 A, motion ramps down";
  return ["bad", "■", "STOPPING", !state.stopping || state.kind === "stopping" ? fading : state.phase];
}

function points_left() { return run && run.name && run.points.length > points_that_are("valid").length + points_that_are("suspect").length; }
const SPECIMEN = { "ok": "OK", "not-ok": "NOT OK", "not-tested": "NOT TESTED", "evaluating": "being evaluated" };
function of_the_end(ended, note) {
  const here = (line) => standing.bench ? line.replace(/rig run --resume .*$/, "Resume on the bench page") : line; // no terminal here
  const lines = (ended.lines || []).map(here).map((line) => /[.!?:;]$/.test(line) ? line : `${line}.`).join(" ");
  if (ended.refused) return ["bad", "✗", "REFUSED", lines + note];
  if (ended.imported) return ["wait", "↥", "IMPORTED", `${ended.valid} of ${ended.total} imported tests valid${note}`];
  if (ended.cut_off) return ["bad", "✗", "INTERRUPTED", `The campaign ended without a result (process killed or power failure). Inspect the rig before you resume the campaign.${note}`];
  if (ended.rig_state === "unknown") return ["bad", "✗", "NOT OK", `RIG STATE UNKNOWN: inspect the rig before continuing. ${lines}${note}`];
  if (ended.stopped_by) return ["bad", "■", "STOPPED", (lines || ended.stopped_by) + note];
  const specimen = ended.specimen && SPECIMEN[ended.specimen.verdict] ? ended.specimen : null;
  if (specimen) note = `. Specimen ${SPECIMEN[specimen.verdict]}${specimen.reason ? `: ${specimen.reason}` : ""}${note}`;
  if (!(ended.valid >= ended.total)) return ["bad", "✗", "NOT OK", `${ended.valid} of ${ended.total} points valid. ${lines}${note}`];
  if (lines) return ["bad", "?", "CHECK", `All ${ended.total} points are valid, but: ${lines}${note}`];
  if (specimen && specimen.verdict === "evaluating") return ["wait", "…", "EVALUATING", `All ${ended.total} points are valid; the specimen is being evaluated.`];
  if (specimen && specimen.verdict !== "ok") return ["bad", specimen.verdict === "not-ok" ? "✗" : "?", SPECIMEN[specimen.verdict], `All ${ended.total} points valid${note}`];
  return ["good", "✓", "OK", `finished; all ${ended.total} points valid${note}`];
}

function judge() {
  const found = opinion(), safe = Boolean(state.ended) && state.ended.rig_state === "safe";
  show_verdict(found);
  if (state.ended && !evaluating()) write("phase", "");
  by_id("stop").classList.toggle("sent", Boolean(stop_asked && stop_asked.taken) && !state.ended);
  const over = Boolean(state.ended) && (!state.running || !connected()); // nothing to stop or command: only verdicts and loops are shown
  if (document.body.classList.contains("over") !== over) { document.body.classList.toggle("over", over); legends(); redraw(); }
  by_id("stop").hidden = over || safe; // until the run has reported its end, the process may still move the rod
  by_id("to-resume").hidden = !(standing.bench && standing.role === "operator" && state.ended && !state.ended.imported && points_left());
  by_id("to-resume").href = `${with_token("/")}&resume=${encodeURIComponent(run ? run.name : "")}`;
  by_id("close").hidden = !(over && connected() && standing.role === "operator") || Boolean(standing.bench);
  document.body.classList.toggle("old", (!connected() || !state.running) && !(over && selected.some(Boolean)));
  document.title = `${found[2]} – MR damper rig`;
  ages();
}
