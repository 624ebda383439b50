// Production view: a serial number starts the test of the next specimen. The server checks it; what is scanned during a test is never kept.

const line = { on: false, serial: "", begun: "", note: "", retest: "", started: 0, over: null, rejected: null };
const VERDICTS = { "ok": ["good", "OK"], "not-ok": ["bad", "NOT OK"], "not-tested": ["wait", "NOT TESTED"] };
window.rigLine = line;

function seconds(s) { return typeof s === "number" ? `${s.toFixed(1)} s` : "–"; }
function line_note(text, over = null) { line.note = text; line.over = over; write("line-note", text || line_wait()); } // `over`: the note that replaces it; undefined as long as it is true
function line_note_over() { // what was true when a note was written
  const next = line.over ? line.over() : undefined;
  if (next !== undefined) line_note(next);
}
function with_minus(text) { return (text || "").replace(/(^|[ (])-(?=\d)/g, "$1−"); }
function without_command(text) { return (text || "").replace(/ ?Continue with: rig run --resume .*$/, ""); } // nobody types it at a line: *Continue* is the way on
function line_open(on) {
  line.on = on; line.serial = ""; line.rejected = null; line_note("");
  document.body.classList.toggle("line-view", on); by_id("line").hidden = !on;
  if (on && plan) sessionStorage.setItem("rig-line", plan.matrix); else sessionStorage.removeItem("rig-line");
  if (on) { by_id("scan").focus(); if (plan && plan.line) say({ do: "prepare" }); } // the first run loads while the specimen is mounted
  line_show();
}
function looks_like_serial(text) { // of this line, for texts in other fields
  if (!line.on || !plan || !plan.line || !plan.line.serial) return false;
  try { return new RegExp(`^(?:${plan.line.serial})$`).test(text.trim()); } catch { return false; } // a pattern of Python alone
}
function line_scan(serial, more = {}) {
  by_id("scan").value = ""; by_id("line-retest").hidden = true; line.retest = "";
  if (!serial) return;
  if (line_busy()) { line_ignored(serial.slice(0, 40)); return; }
  line.rejected = null;
  if (!standing.mine) { line_reject(serial, "Type your name and take control first.", () => !standing.mine); return; }
  if (!plan || !plan.feasible || !plan.line) { line_reject(serial, "Leave the production view and choose a matrix."); return; }
  stop_asked = null; line.serial = serial; line_note("");
  sending = say({ do: "begin", matrix: plan.matrix, planned: plan.planned, serial_number: serial, line: true, after: line.after || "", ...more });
  if (!sending) line_note(`${serial}: not sent. There is no connection to the rig.`, () => connected() ? `${serial} was not sent. Scan it again.` : undefined);
  line_show();
}
// A serial number that starts no test is shown large: the verdict of the specimen before must not be taken for that of the one that is mounted. `holds`: as long as it is true
function line_reject(serial, text, holds = () => true) { line.rejected = { serial: serial.slice(0, 40), text, holds }; line_note(""); line_show(); }
function line_busy() { return sending || busy(); }
function line_ended() { const last = runs[0]; return line.serial || (last && last.ended === "running" ? last.specimen : "") || bench.run; } // what is evaluated
function line_report() { return bench.phase === "evaluating" ? line_ended() : ""; } // whose report is still being written, if any
function line_ignored(name, during = "") { // a scan: what the next one has to wait for follows the phase, when it was scanned does not
  const written = line_report(), then = during || (written ? `while the report of ${written} was being written` : "during a test");
  const again = `${name} was scanned ${then} and was ignored. Mount the specimen, then scan it again.`;
  const before = during ? `${name} was scanned ${during} and was ignored. The report of ${written} is still being written.` : `${name}: ignored because the report of ${written} is still being written.`;
  line_note(written ? `${before} Scan it again when this line asks for it.`
    : `${name}: ignored because a specimen is being tested. Wait for the result, change the specimen, then scan again.`,
  () => {
    if (!line_busy()) return again;
    if (line_report() !== written) line_ignored(name, then);
    return undefined;
  });
}
function line_wait() { // what the next scan would do, where no note says something else
  if (line_report()) return `The report of ${line_report()} is still being written. Wait before you scan the next serial number.`;
  const ready = standing.mine && connected() && !line_busy() && plan && plan.feasible && plan.line;
  if (ready && line_stopped() && line.after !== (runs[0] || {}).name) return "Eliminate the cause of the stop, press Continue, then scan the next serial number.";
  return ready ? "Ready for the next serial number." : "";
}
function line_answered(message) { // of `begin`; true where the production view has shown it
  if (!line.on) return false;
  if (message.ok) { line.started = performance.now(); return true; }
  line_reject(line.serial, words_of(message));
  if (message.refused === "tested-before") { line.retest = line.serial; by_id("line-retest").hidden = false; by_id("line-retest").textContent = `Retest ${line.serial}`; }
  line.serial = ""; line_show();
  return true;
}
function line_state() { // what is shown large: kind, verdict, specimen, reason
  const last = runs[0];
  if (!connected()) return ["bad", "NO CONNECTION", "", "The page is not being served, or the network is down. A test in progress continues."];
  if (bench.phase === "starting" || bench.phase === "running" || (sending && line.serial)) return ["wait", "TESTING", line.serial || (last && last.ended === "running" ? last.specimen : ""), `${state.running && state.phase ? state.phase : "starting"}${state.point ? `, ${state.point}` : ""}`];
  if (bench.phase === "evaluating") {
    const ended = state.ended || {}, early = VERDICTS[(ended.specimen || {}).verdict]; // the verdict comes before the report is written
    const serial = line_ended();
    if (early && ended.valid === ended.total && ended.rig_state === "safe" && !ended.stopped_by) return [early[0], early[1], serial, ended.specimen.reason];
    return ["wait", "EVALUATING", serial, ""];
  }
  if (line.rejected) return ["bad", "NOT STARTED", line.rejected.serial, line.rejected.text];
  const outcome = bench.outcome || {}, newer = Boolean(last && bench.started && last.started > bench.started.utc.slice(0, 19));
  if (!newer && (outcome.broken || outcome.refused)) return ["bad", outcome.stopped ? "STOPPED" : outcome.broken ? "ERROR" : "REFUSED", line.serial, outcome.text || ""];
  if (!last) return ["wait", "SCAN", "", "Mount the first specimen, then scan its serial number."];
  if (last.rig_state === "unknown") return ["bad", "RIG STATE UNKNOWN", last.specimen, `Inspect the rig. ${last.text}`];
  if (last.ended === "refused") return ["bad", "REFUSED", last.specimen, last.text];
  if (last.ended === "stopped" || last.ended === "interrupted") return ["bad", "STOPPED", last.specimen, without_command(last.text)];
  const known = VERDICTS[last.specimen_verdict];
  if (!known) return ["wait", "SCAN", "", "Mount the next specimen, then scan its serial number."];
  const test = last.valid < last.total ? ` (${last.valid} of ${last.total} points valid)` : "";
  return [known[0], known[1], last.specimen, last.specimen_reason + test];
}
function line_stopped() { const last = runs[0]; return Boolean(last) && (["stopped", "interrupted"].includes(last.ended) || last.rig_state === "unknown"); }
function large(id, text) { // as large as its letters allow, see line.css
  write(id, text);
  by_id(id).style.setProperty("--letters", text.length); by_id(id).style.setProperty("--word", Math.max(...text.split(" ").map((word) => word.length)));
}
function line_show() {
  by_id("line-open").hidden = !(plan && plan.line); by_id("line-open").disabled = !(plan && plan.line && plan.feasible);
  if (!line.on) return;
  line_note_over();
  if (line_busy() || (line.rejected && !line.rejected.holds())) line.rejected = null;
  by_id("line-form").hidden = standing.role === "viewer"; // a large screen for everybody
  const [kind, verdict, specimen, reason] = line_state();
  if (by_id("line-result").className !== kind) by_id("line-result").className = kind;
  write("line-note", line.note || line_wait()); by_id("line-note").classList.toggle("hint", !line.note);
  large("line-verdict", verdict); write("line-specimen", specimen); write("line-reason", with_minus(reason));
  for (const name of ["ok", "not-ok", "not-tested"]) write(`count-${name}`, String((line.today || {})[name] || 0));
  write("takt-last", seconds((line.today || {}).takt_last_s)); write("takt-mean", seconds((line.today || {}).takt_mean_s));
  by_id("line-continue").hidden = !(line_stopped() && !line_busy() && line.after !== (runs[0] || {}).name && standing.mine);
}
function line_history(message) {
  line.today = message.today || {};
  const body = by_id("line-history").tBodies[0]; body.replaceChildren();
  for (const run of runs.slice(0, 30)) {
    const neutral = ["finished", "imported", "running"].includes(run.ended) ? "" : "bad"; // a run without acceptance bands is not a bad specimen
    const known = VERDICTS[run.specimen_verdict] || [neutral, run.ended], row = element("tr", undefined, known[0] === "good" ? "" : known[0] && "bad");
    row.append(element("td", local(run.started).slice(11)), element("td", run.specimen), element("td", `${known[0] === "good" ? "✓" : known[0] ? "✗" : run.ended === "running" ? "▶" : "–"} ${known[1]}`, "mark"), element("td", with_minus(run.specimen_reason || without_command(run.text))), element("td", seconds(run.takt_s), "numeric"));
    body.append(row);
  }
}

by_id("line-form").onsubmit = (event) => { event.preventDefault(); line_scan(by_id("scan").value.trim()); };
by_id("scan").onkeydown = (event) => { // some readers end a code with Tab
  if (event.key === "Tab" && by_id("scan").value.trim()) { event.preventDefault(); line_scan(by_id("scan").value.trim()); }
};
by_id("line-retest").onclick = () => { const serial = line.retest; line_scan(serial, { retest: true }); by_id("scan").focus(); };
by_id("line-continue").onclick = () => { line.after = runs[0] ? runs[0].name : ""; line_note("The cause of the stop is confirmed as eliminated. Scan the next serial number."); by_id("line-continue").hidden = true; by_id("scan").focus(); };
if (new URLSearchParams(location.search).has("production")) addEventListener("load", () => line_open(true)); // an address for large screens
by_id("line-open").onclick = () => line_open(true);
by_id("line-leave").onclick = () => line_open(false);
// A reader in keyboard mode types wherever the focus is: its text goes into the serial number, and its Enter presses no button.
document.addEventListener("keydown", (event) => {
  if (!line.on || event.ctrlKey || event.altKey || event.metaKey || /^(INPUT|TEXTAREA)$/.test(event.target.tagName)) return;
  if (event.key.length === 1) { event.stopPropagation(); by_id("scan").focus(); }
}, true);
