/** The panel of people: a table, with the details of the one who is selected. */

import { GROUPS } from "./colours.js";
import { byId, keepChildren, make, reveal, setAttribute, setText } from "./dom.js";
import { duration, fixed } from "./format.js";

/** Key of the row with the details of the selected person, below theirs. */
const DETAILS = "details";

export class PeoplePanel {
  constructor(scene, onSelect) {
    this._scene = scene;
    this._onSelect = onSelect;
    this._body = byId("people").querySelector("tbody");
    this._empty = byId("people").querySelector(".empty");
  }

  update(selected) {
    const people = this._scene.state?.people ?? [];
    const waits = this._scene.hello?.mode !== "bag" && (this._scene.state?.t ?? null) === null;
    setText(this._empty, waits ? "Waiting for people." : "Nobody is on the map.");
    this._empty.hidden = people.length > 0;
    this._body.parentElement.hidden = people.length === 0;
    const rows = people
      .map((person, index) => ({ person, key: person.id || `unnamed ${index}` }))
      .sort((a, b) => Number(b.person.straggler) - Number(a.person.straggler) || a.person.id - b.person.id);
    const place = rows.findIndex(({ person }) => person.id !== 0 && person.id === selected.person);
    if (place >= 0) rows.splice(place + 1, 0, { person: rows[place].person, key: DETAILS });
    keepChildren(
      this._body, rows, ({ key }) => key,
      ({ person, key }) => (key === DETAILS ? createDetails() : this._createRow(person.id)),
      (row, { person, key }) => {
        if (key === DETAILS) updateDetails(row, person, this._seen(person));
        else updateRow(row, person, this._seen(person), person.id !== 0 && person.id === selected.person);
      },
    );
  }

  /** Scroll the row of a person and their details into view. */
  reveal(id) {
    reveal(this._body.querySelector(`[data-key="${DETAILS}"]`));
    reveal(this._body.querySelector(`[data-key="${Number(id)}"]`));
  }

  /** Return whether a person fell behind and when they were last seen, in words. */
  _seen(person) {
    const silent = this._scene.silence(performance.now());
    const before = person.seen_s === null ? "before" : `${duration(person.seen_s + silent)} ago`;
    const last = silent ? `${duration(silent)} ago` : "now";
    const seen = person.predicted ? before : last;
    if (!person.straggler) return seen;
    const behind = this._scene.behind.get(person.id) ?? "behind";
    return seen === "now" ? behind : `${behind}, seen ${seen}`;
  }

  _createRow(id) {
    const name = id
      ? make("button", { type: "button", class: "select", "aria-pressed": "false", "aria-label": `Person ${id}` }, `${id}`)
      : make("span", {}, "–");
    const cells = ["group", "number place", "number speed", "number height wide", "seen"];
    const row = make(
      "tr", {}, make("th", { scope: "row" }, name), ...cells.map((kind) => make("td", { class: kind })),
    );
    row.addEventListener("click", () => id && this._onSelect(id));
    return row;
  }
}

function createDetails() {
  return make("tr", { class: "details" }, make("td", { colspan: "6" }, make("dl")));
}

function updateDetails(row, person, seen) {
  keepChildren(
    row.querySelector("dl"), factsOf(person, seen), ([name]) => name,
    ([name]) => make("div", {}, make("dt", {}, name), make("dd")),
    (entry, [, value]) => setText(entry.lastChild, value),
  );
}

function updateRow(row, person, seenText, selected) {
  const [name, group, place, speed, height, seen] = row.children;
  setAttribute(row, "class", `${person.straggler ? "straggler" : ""} ${selected ? "selected" : ""}`.trim() || null);
  if (person.id) setAttribute(name.firstChild, "aria-pressed", selected);
  setText(group, person.group === null ? "–" : String(person.group));
  setAttribute(group, "data-group", person.group === null ? null : person.group % GROUPS);
  setText(place, `${fixed(person.x, 1)}, ${fixed(person.y, 1)}`);
  setText(speed, person.vx === null ? "–" : fixed(Math.hypot(person.vx, person.vy), 1));
  setText(height, person.height === null ? "–" : fixed(person.height, 2));
  setText(seen, seenText);
}

function factsOf(person, seen) {
  const [xx, , yy] = person.cov;
  const sigma = xx === null || yy === null ? "" : ` ± ${fixed(Math.sqrt((xx + yy) / 2), 2)} m`;
  const way = person.vx === null ? "–" : `${fixed(Math.hypot(person.vx, person.vy), 2)} m/s${heading(person)}`;
  return [
    ["Position", `${fixed(person.x, 2)}, ${fixed(person.y, 2)}${sigma}`],
    ["Speed", way],
    ["Height", person.height === null ? "–" : `${fixed(person.height, 2)} m`],
    ["Group", person.group === null ? "none" : String(person.group)],
    ["Seen", seen],
    ...(person.seen_at ? [["Last seen at", person.seen_at.map((metres) => fixed(metres, 2)).join(", ")]] : []),
    ["Known for", duration(person.age)],
  ];
}

function heading({ vx, vy }) {
  if (Math.hypot(vx, vy) < 0.15) return "";
  const degrees = Math.round((Math.atan2(vy, vx) * 180) / Math.PI);
  return ` at ${fixed(degrees, 0)}°`;
}
