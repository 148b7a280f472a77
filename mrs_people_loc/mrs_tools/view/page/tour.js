/** The panel of a guided tour: how it goes on; start and stop, where the server allows it. */

import { byId, keepChildren, make, setText } from "./dom.js";
import { duration, fixed } from "./format.js";

const STATES = {
  idle: "No tour runs",
  gathering: "Gathering at the start",
  leading: "Leading the group",
  waiting: "Waiting for people",
  at_stop: "At a stop",
  finished: "Finished",
  cancelled: "Cancelled",
  halted: "Halted",
  stopped: "Stopped",
};
/** The guide speaks several times a second. */
const SILENT_S = 3;
const RUNNING = new Set(["gathering", "leading", "waiting", "at_stop", "halted", "stopped"]);

/** Return the state of a tour in words. */
export const tourState = (tour) => STATES[tour.state] ?? tour.state;
/** Return the same in as few words as possible. */
export const tourStateShort = (tour) => tour.state.replace("_", " ");
export const tourRuns = (tour) => tour !== null && tour !== undefined && RUNNING.has(tour.state);

export class TourPanel {
  constructor(scene, send) {
    this._scene = scene;
    this._send = send;
    this._state = byId("tour-state");
    byId("tour-form").addEventListener("submit", (event) => {
      event.preventDefault();
      const name = byId("tour-name").value;
      const text = `“${name}” starts as soon as the group is there. The robots will move.`;
      this._ask("Start the tour?", text, "Start", { type: "tour", start: name });
    });
    byId("tour-cancel").addEventListener("click", () => this._send({ type: "tour", cancel: true }));
    byId("robots-stop").addEventListener("click", () => this.stop());
    byId("robots-release").addEventListener("click", () => {
      const text = "See that nobody is in danger: the robots may move at once.";
      this._ask("Release the robots?", text, "Release", { type: "release" });
    });
  }

  /** Return whether the panel has something to show. */
  get useful() {
    const { hello, state } = this._scene;
    return Boolean(state?.tour || hello?.tours.length || hello?.control);
  }

  /** Return whether there are robots that may be stopped: by anybody. */
  get stoppable() {
    const { hello, state } = this._scene;
    return hello?.mode === "live" && tourRuns(state?.tour) && state.tour.state !== "stopped";
  }

  stop() {
    this._send({ type: "stop" });
  }

  update() {
    const { hello, state } = this._scene;
    const tour = state?.tour ?? null;
    this._show(tour);
    const names = hello?.tours ?? [];
    const control = Boolean(hello?.control);
    byId("tour-form").hidden = !control || names.length === 0 || tourRuns(tour);
    byId("robots-stop").hidden = hello?.mode !== "live" || !tour || tour.state === "stopped";
    byId("robots-release").hidden = !control || tour?.state !== "stopped";
    byId("tour-cancel").hidden = !control || !tourRuns(tour) || !tour.name;
    keepChildren(
      byId("tour-name"), names, (name) => name, (name) => make("option", { value: name }, name), () => {},
    );
    setText(byId("tour-hint"), hintOf(hello, control, names));
  }

  _show(tour) {
    if (!this._state.firstChild) {
      this._state.append(
        make("h2"), make("p", { class: "state" }), make("progress", { max: "1", "aria-label": "Progress of the tour" }),
        make("p", { class: "facts" }), make("ul", { class: "posts" }),
      );
    }
    const [title, text, bar, facts, posts] = this._state.children;
    setText(title, tour?.name || "Tour");
    setText(text, tour ? `${tourState(tour)}${tour.message ? `: ${tour.message}` : ""}` : "No tour runs");
    const stands = tour?.state === "halted" || tour?.state === "stopped";
    text.dataset.level = stands ? "error" : tour?.state === "waiting" ? "warning" : "ok";
    const started = tour && tour.state !== "idle";
    bar.hidden = facts.hidden = !started;
    keepChildren(
      posts, tour?.posts ?? [], ({ robot }) => robot,
      ({ robot }) => make("li", {}, make("b", {}, robot), " ", make("span")),
      (item, { role }) => setText(item.lastChild, role),
    );
    if (!started) return;
    bar.value = tour.progress;
    setText(facts, factsOf(tour));
  }

  /** What moves robots is asked for first. */
  _ask(title, text, verb, command) {
    const dialog = byId("confirm");
    setText(byId("confirm-title"), title);
    setText(byId("confirm-text"), text);
    setText(byId("confirm-go"), verb);
    dialog.returnValue = "cancel";
    dialog.onclose = () => dialog.returnValue === "go" && this._send(command);
    dialog.showModal();
    byId("confirm-cancel").focus();
  }
}

function factsOf(tour) {
  const parts = [`${fixed(tour.way, 1)} of ${fixed(tour.length, 1)} m`];
  if (tour.stop) parts.push(tour.state === "at_stop" ? `at ${tour.stop}` : `next stop: ${tour.stop}`);
  if (tour.leader) parts.push(`leader: ${tour.leader}`);
  if (tour.age > SILENT_S) parts.push(`no word from the guide for ${duration(tour.age)}`);
  if (tour.lost.length) parts.push(`goes on without ${tour.lost.join(", ")}`);
  return parts.join(" · ");
}

function hintOf(hello, control, names) {
  if (!hello || hello.mode === "bag") return "";
  if (!control) {
    return "This page only shows, and stops robots. Started with --control, mrs view starts tours and releases robots.";
  }
  return names.length ? "" : "No tour to start: mrs view --control --tour FILE.yaml";
}
