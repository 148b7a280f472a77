/** The panel of the team's health: what `mrs doctor` says. */

import { byId, keepChildren, make, setText } from "./dom.js";
import { count } from "./format.js";

const WORDS = { ok: "OK", warning: "Warning", error: "Error", waiting: "Waiting" };
const SUMMARIES = {
  ok: "Everything is well.",
  warning: "It works, with warnings.",
  error: "Something does not work.",
  waiting: "Waiting for the nodes.",
};

export class HealthPanel {
  constructor(scene) {
    this._scene = scene;
    this._summary = byId("health-summary");
    this._list = byId("health").querySelector("ul");
  }

  update() {
    const { health } = this._scene;
    setText(this._summary, health ? SUMMARIES[health.level] : "Not known yet.");
    this._summary.dataset.level = health?.level ?? "waiting";
    keepChildren(
      this._list, health?.findings ?? [], ({ subject, text }) => `${subject}\n${text}`,
      () => make(
        "li", {}, make("p", { class: "state" }), make("p", { class: "text" }),
        make("p", { class: "advice" }), make("ul", { class: "follows" }),
      ),
      updateFinding,
    );
  }
}

function updateFinding(card, finding) {
  const [state, text, advice, follows] = card.children;
  state.dataset.level = finding.level;
  setText(state, `${WORDS[finding.level]}: ${finding.subject}`);
  setText(text, finding.text);
  setText(advice, finding.advice);
  advice.hidden = !finding.advice;
  keepChildren(
    follows, finding.follows ?? [], (line) => line, () => make("li"), (item, line) => setText(item, line),
  );
}

function problems(health) {
  return (health?.findings ?? []).filter(({ level }) => level === "warning" || level === "error");
}

/** Return what the badge of the tab says: "" or "2!". */
export function healthBadge(health) {
  const { length } = problems(health);
  return length ? `${length}!` : "";
}

/** Return the number of problems in words, or "". */
export function problemsInWords(health) {
  const bad = problems(health);
  const [errors, all] = [bad.filter(({ level }) => level === "error").length, bad.length];
  if (errors === all) return all ? count(all, "error", "errors") : "";
  return errors ? `${all} problems` : count(all, "warning", "warnings");
}
