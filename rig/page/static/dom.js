// Small helpers of both views. Text is always set as text, never as markup.

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
function answer(text) { by_id("answer").textContent = text; }
function duration(s) {
  if (typeof s !== "number") return "";
  return s >= 3600 ? `${Math.floor(s / 3600)} h ${Math.floor(s % 3600 / 60)} min` : s >= 60 ? `${Math.floor(s / 60)} min ${Math.floor(s % 60)} s` : `${Math.max(0, Math.round(s))} s`;
}
const dark = window.matchMedia("(prefers-color-scheme: dark)");
function theme() {
  const chosen = localStorage.getItem("rig-page-theme");
  document.documentElement.classList.toggle("dark", chosen ? chosen === "dark" : dark.matches);
}
