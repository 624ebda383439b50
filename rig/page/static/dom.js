// What both views have in common: small helpers, banner, control, theme. Text is always set as text, never as markup.

const by_id = (id) => document.getElementById(id);
function element(name, text, kind) {
  const made = document.createElement(name);
  if (text !== undefined) made.textContent = text;
  if (kind) made.className = kind;
  return made;
}
function push_button(text, title, press) {
  const button = element("button", text); button.type = "button"; button.title = title; button.onclick = press;
  return button;
}
function write(id, text) { if (by_id(id).textContent !== text) by_id(id).textContent = text; } // only changes, which screen readers announce
let answer_holds = null; // as long as it is true the answer is shown; null: until the next one
function answer(text, holds = null) { by_id("answer").textContent = text; answer_holds = holds; }
function answer_over() { if (answer_holds && !answer_holds()) answer(""); }
function for_a_while(s = 15) { const until = performance.now() + 1000 * s; return () => performance.now() < until; }
function duration(s) {
  if (typeof s !== "number") return "";
  return s >= 3600 ? `${Math.floor(s / 3600)} h ${Math.floor(s % 3600 / 60)} min` : s >= 60 ? `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s` : `${Math.max(0, Math.round(s))} s`;
}
const dark = window.matchMedia("(prefers-color-scheme: dark)");
function theme() {
  const chosen = localStorage.getItem("rig-page-theme");
  document.documentElement.classList.toggle("dark", chosen ? chosen === "dark" : dark.matches);
}
function other_theme() { localStorage.setItem("rig-page-theme", document.documentElement.classList.contains("dark") ? "light" : "dark"); }
function show_verdict([kind, sign, verdict, why]) { // in the banner
  if (by_id("banner").className !== kind) by_id("banner").className = kind;
  write("sign", sign); write("verdict", verdict); write("why", why);
}
function show_lease(standing) { // who has control, and what this viewer may do about it
  const viewer = standing.role === "viewer", mine = standing.mine;
  by_id("standing").textContent = mine ? `You have control, ${standing.holder}.` : standing.holder ? `${standing.holder} has control.` : viewer ? "You are a viewer; you can only stop the rig." : "No operator has control.";
  by_id("lease").hidden = viewer; by_id("take").hidden = mine; by_id("name").hidden = mine; by_id("release").hidden = !mine;
  by_id("viewers").hidden = !standing.viewer_url; by_id("viewer-url").textContent = standing.viewer_url || "";
  if (mine && by_id("answer").textContent === NO_LEASE) answer("");
}
const NO_LEASE = "Take control first.";
