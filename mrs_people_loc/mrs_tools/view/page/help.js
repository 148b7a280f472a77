/** The help dialog, the legend, and the single-key shortcuts. */

import { byId, make, setText } from "./dom.js";

const STORED = "mrs-view-shortcuts";
const NAMES = { Escape: "Esc", " ": "Space" };
/** What takes a key itself: Space presses buttons, but does nothing on a slider. */
const TAKES_KEYS = "select, input, textarea";
const TAKES_SPACE = "select, input:not([type=range]), textarea, button, a";
const LEGEND = [
  ["person", "Person with id; they are 95 % likely to be inside the ellipse; the arrow ends where they will be in one second"],
  ["predicted", "Not seen just now: position predicted"],
  ["straggler", "Straggler: has fallen behind the group, with the time since"],
  ["groups", "Each group has a colour, on the map and in the list of people; who has none is grey"],
  ["group", "Centre of a group, linked to its people"],
  ["robot", "Robot and its field of view; it is 95 % likely to be inside the ellipse"],
  ["unwell", "Hollow and dashed: robot without a recent pose, or not well"],
  ["post", "Post of a robot in the tour"],
  ["truth", "True position of a person, where a recording has it"],
];

export class Help {
  /** `shortcuts`: [key, description (empty: not listed), action; false: the key did nothing]. */
  constructor(shortcuts) {
    this._actions = new Map(shortcuts.map(([key, , action]) => [key.toLowerCase(), action]));
    const on = byId("shortcuts-on");
    on.checked = recall() !== "off";
    on.addEventListener("change", () => remember(on.checked ? "on" : "off"));
    byId("help-open").addEventListener("click", () => this.open());
    byId("shortcuts").append(
      ...shortcuts.filter(([, text]) => text).map(([key, text]) =>
        make("div", {}, make("dt", {}, make("kbd", {}, NAMES[key] ?? key.toUpperCase())), make("dd", {}, text)),
      ),
    );
    byId("legend").append(
      ...LEGEND.map(([sign, text]) => make("li", {}, make("i", { class: `sign ${sign}`, "aria-hidden": "true" }), make("span", {}, text))),
    );
    document.addEventListener("keydown", (event) => this._key(event));
  }

  open() {
    byId("help").showModal();
    byId("help-close").focus();
  }

  setVersion(text) {
    setText(byId("version"), text);
  }

  _key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    if (!byId("shortcuts-on").checked || document.querySelector("dialog[open]")) return;
    if (event.target.matches(event.key === " " ? TAKES_SPACE : TAKES_KEYS)) return;
    const action = this._actions.get(event.key.toLowerCase());
    if (action && action() !== false) event.preventDefault();
  }
}

function recall() {
  try {
    return localStorage.getItem(STORED);
  } catch {
    return null; // storage is blocked
  }
}

function remember(value) {
  try {
    localStorage.setItem(STORED, value);
  } catch {
    // storage is blocked: it holds until the page is closed
  }
}
