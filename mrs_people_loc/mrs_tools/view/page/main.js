/** The page of `mrs view`: puts its parts together. */

import { Announcer } from "./announcer.js";
import { Connection } from "./connection.js";
import { byId, keepChildren, make, setAttribute, setText } from "./dom.js";
import { EventsPanel } from "./events.js";
import { duration } from "./format.js";
import { healthBadge, HealthPanel, problemsInWords } from "./health.js";
import { Help } from "./help.js";
import { MapView } from "./map.js";
import { PeoplePanel } from "./people.js";
import { RobotsPanel } from "./robots.js";
import { Scene } from "./scene.js";
import { Tabs } from "./tabs.js";
import { Timeline } from "./timeline.js";
import { TourPanel, tourRuns, tourState, tourStateShort } from "./tour.js";

/** Of the messages, see protocol.py. */
const PROTOCOL = 1;
/** Texts change at most this often: faster could not be read. */
const TEXT_MS = 250;
const ANSWER_MS = 5000;

export const scene = new Scene();
export const map = new MapView(byId("map"), scene, { onSelect: select, onMode: showTools });
const announcer = new Announcer();
const people = new PeoplePanel(scene, (id) => select(id === map.selected.person ? {} : { person: id ?? undefined }));
const robots = new RobotsPanel(scene, {
  onLook: look,
  onSelect: (name) => select(name === map.selected.robot ? {} : { robot: name }),
});
const tour = new TourPanel(scene, send);
const panels = { people, robots, tour, events: new EventsPanel(scene), health: new HealthPanel(scene) };
const timeline = new Timeline(scene, send);
const tabs = new Tabs((name) => {
  if (name !== "robots") robots.clearImages();
  showPanel();
  look();
});
const help = new Help([
  ["?", "This help", () => help.open()],
  ["+", "Zoom in", () => map.zoom(1.25)],
  ["=", "", () => map.zoom(1.25)],
  ["-", "Zoom out", () => map.zoom(0.8)],
  ["0", "Fit everything", () => map.setMode("fit")],
  ["g", "Follow the group, or the selected person", () => map.setMode("follow")],
  ["c", "Show cells", toggleCells],
  ["n", "Select the next person", () => selectNext(1)],
  ["p", "Select the previous person", () => selectNext(-1)],
  ["Escape", "Clear the selection", () => select({})],
  ...["people", "robots", "tour", "events", "health"].map((name, index) => [
    String(index + 1), `Panel ${name}`, () => tabs.show(name),
  ]),
  [" ", "Recording: play or pause", () => timeline.toggle()],
  ["k", "", () => timeline.toggle()],
  ["j", "Recording: 5 s back", () => timeline.skip(-5)],
  ["l", "Recording: 5 s forward", () => timeline.skip(5)],
]);

// The token, if there is one, is part of the address of the page.
const address = new URL(`live${location.search}`, location.href);
address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
export const connection = new Connection(address, { onMessage: take, onChange: connectionChanged });

let textTimer = 0;
let lastLook = "";
let answerTimer = 0;

function take(message) {
  if (message.type === "answer") {
    timeline.answered();
    // Of a recording, the page itself shows what was done.
    if (!message.ok || scene.hello?.mode === "live") showAnswer(message);
    return;
  }
  const before = scene.state;
  scene.apply(message, performance.now());
  if (message.type === "hello") welcome(message);
  if (message.type === "state") announceChanges(before, message);
  if (message.type === "map") map.takeMap();
  if (message.type === "state" || (message.type === "cells" && map.cells)) map.invalidate();
  textsSoon();
}

function welcome(hello) {
  const title = hello.mode === "bag" ? `Recording: ${hello.title}` : hello.title;
  setText(byId("title"), title);
  byId("title").title = title;
  document.title = title ? `${title} – mrs view` : "mrs view";
  if (hello.mode !== "bag") scene.time = null;
  const other = hello.version === PROTOCOL ? "" : " This page is of another version than the server: reload it.";
  help.setVersion(`Protocol ${hello.version}, ${hello.mode === "bag" ? "recording" : "live"}.${other}`);
  if (other) showAnswer({ ok: false, text: other.trim() });
  lastLook = "";
  look();
}

function connectionChanged() {
  if (connection.phase === "waiting") lastLook = "";
  showConnection();
}

function send(message) {
  if (!connection.send(message)) showAnswer({ ok: false, text: "Not connected: nothing was sent." });
}

/** Tell the server what is looked at; nothing while the page is in the background. */
function look() {
  const images = tabs.open === "robots" && !document.hidden ? [...robots.open].sort() : [];
  const message = { type: "look", cells: map.cells && !document.hidden, robots: images };
  const text = JSON.stringify(message);
  if (text !== lastLook && connection.send(message)) lastLook = text;
}

function showAnswer({ ok, text }) {
  const answer = byId("answer");
  setText(answer, text);
  answer.dataset.level = ok ? "ok" : "error";
  answer.hidden = !text;
  clearTimeout(answerTimer);
  answerTimer = setTimeout(() => (answer.hidden = true), ANSWER_MS);
}

// ------------------------------------------------------------------------------ selecting, map

function select(selected) {
  map.selected = selected;
  if (selected.person) tabs.show("people");
  if (selected.robot) tabs.show("robots");
  map.invalidate();
  showPanel();
  if (selected.person) people.reveal(selected.person);
  if (selected.robot) robots.reveal(selected.robot);
}

function selectNext(step) {
  const ids = (scene.state?.people ?? []).map(({ id }) => id).filter(Boolean).sort((a, b) => a - b);
  if (!ids.length) return;
  const here = ids.indexOf(map.selected.person);
  const next = here < 0 ? (step > 0 ? 0 : ids.length - 1) : (here + step + ids.length) % ids.length;
  select({ person: ids[next] });
  announcer.say(`Person ${ids[next]} selected.`);
}

function toggleCells() {
  map.cells = !map.cells;
  scene.cells = null;
  showTools();
  map.invalidate();
  look();
}

function showTools() {
  for (const button of document.querySelectorAll("[data-map][aria-pressed]")) {
    const on = button.dataset.map === "cells" ? map.cells : map.mode === button.dataset.map;
    button.setAttribute("aria-pressed", on);
  }
}

// ------------------------------------------------------------------------------ texts

function textsSoon() {
  if (textTimer) return;
  textTimer = setTimeout(() => {
    textTimer = 0;
    showTexts();
  }, TEXT_MS);
}

function showTexts() {
  if (scene.renewBehind()) map.invalidate();
  tabs.setHidden("tour", !tour.useful);
  setText(byId("tab-people").querySelector(".count"), String(scene.state?.people.length ?? ""));
  setText(byId("tab-robots").querySelector(".count"), String(scene.state?.robots.length ?? ""));
  setText(byId("tab-health").querySelector(".count"), healthBadge(scene.health));
  showSummary();
  showConnection();
  timeline.update();
  showPanel();
}

function showPanel() {
  panels[tabs.open].update(map.selected);
}

/** Show what an operator must not miss, whichever panel is open. */
function showSummary() {
  const { state, health } = scene;
  const items = [...behindChips(state?.people ?? [])];
  if (state?.tour && state.tour.state !== "idle") {
    const share = tourRuns(state.tour) ? ` ${Math.round(100 * state.tour.progress)} %` : "";
    items.push({ key: "tour", text: `Tour${share}: ${tourStateShort(state.tour)}`, open: "tour" });
  }
  const problems = problemsInWords(health);
  if (problems) items.push({ key: "health", text: problems, level: health.level, open: "health" });
  if (tour.stoppable) items.push({ key: "stop", text: "Stop the robots", stop: true });
  const summary = byId("summary");
  keepChildren(summary, items, ({ key }) => key, createChip, updateChip);
  map.setInsetTop(items.length ? summary.offsetTop + summary.offsetHeight : 0);
}

function behindChips(everybody) {
  const behind = everybody.filter(({ straggler }) => straggler);
  if (behind.length > 2) {
    return [{ key: "behind", text: `${behind.length} have fallen behind`, level: "error", open: "people" }];
  }
  return behind.map(({ id }) => ({
    key: `behind ${id}`,
    text: `${id} ${scene.behind.get(id)}`,
    level: "error",
    person: id,
  }));
}

function createChip(item) {
  const button = make("button", { type: "button", class: item.stop ? "danger" : null });
  button.addEventListener("click", () => {
    if (item.stop) tour.stop();
    else if (item.open) tabs.show(item.open);
    else select({ person: item.person });
  });
  return make("li", {}, button);
}

function updateChip(chip, { text, level }) {
  setText(chip.firstChild, text);
  setAttribute(chip.firstChild, "data-level", level ?? null);
}

function announceChanges(before, state) {
  for (const { id, straggler } of state.people) {
    if (straggler && before && !before.people.find((p) => p.id === id)?.straggler) {
      announcer.say(`Person ${id} has fallen behind.`);
    }
  }
  if (before?.tour && state.tour && before.tour.state !== state.tour.state) {
    announcer.say(`Tour: ${tourState(state.tour)}.`);
  }
}

// ------------------------------------------------------------------------------ connection

/** Return [level, short text, long text (empty: all is well)] of the connection and the data. */
function connectionInWords() {
  if (connection.phase !== "open") {
    const first = scene.hello === null && connection.phase === "connecting";
    if (first) return ["wait", "Connecting", "Connecting"];
    const wait = Math.ceil((connection.retryAt - performance.now()) / 1000);
    const next = connection.phase === "waiting" && wait > 0 ? `Next attempt in ${wait} s.` : "Connecting…";
    const old = scene.state ? " The map shows the last known state." : "";
    return ["error", "No connection", `No connection to mrs view. ${next}${old}`];
  }
  if (scene.time) return ["ok", scene.time.playing ? "Playing" : "Paused", ""];
  if (scene.hello?.mode === "bag") return ["wait", "Opening", ""];
  const silent = scene.silence(performance.now());
  const waits = !scene.state || scene.state.t === null;
  const start = scene.health?.findings.find(({ subject }) => subject === "start");
  if (start && (waits || silent)) return ["wait", "One moment", start.text];
  if (waits) {
    return ["wait", "Waiting for data", "Connected. No people message has come yet: is a planner running?"];
  }
  if (!silent) return ["ok", "Live", ""];
  const wait = duration(Math.floor(silent));
  return ["error", `No data for ${wait}`, `Last heard ${wait} ago. The map shows the last known state.`];
}

function showConnection() {
  const [level, short, long] = connectionInWords();
  const pill = byId("connection");
  if (pill.dataset.level !== level && pill.dataset.level !== "wait") {
    const again = scene.time ? "Connected again." : "Live again.";
    announcer.say(level === "ok" ? again : long);
  }
  pill.dataset.level = level;
  setText(pill.lastElementChild, short);
  document.body.dataset.connection = level;
  byId("notice").hidden = !long;
  setText(byId("notice-text"), long);
  byId("retry").hidden = connection.phase !== "waiting";
}

// ------------------------------------------------------------------------------ start

const tools = {
  "zoom-in": () => map.zoom(1.4),
  "zoom-out": () => map.zoom(1 / 1.4),
  fit: () => map.setMode("fit"),
  follow: () => map.setMode("follow"),
  cells: toggleCells,
};
for (const button of document.querySelectorAll("[data-map]")) {
  button.addEventListener("click", tools[button.dataset.map]);
}
byId("retry").addEventListener("click", () => connection.retry());
document.addEventListener("visibilitychange", look);
const calm = matchMedia("(prefers-reduced-motion: reduce)");
scene.smooth = !calm.matches;
calm.addEventListener("change", () => (scene.smooth = !calm.matches));
setInterval(() => {
  showConnection();
  if (scene.silence(performance.now())) showPanel(); // no message comes that would
}, 500);
connection.start();
showTexts();
