/** The panel of events, the newest first. */

import { byId, keepChildren, make, setText } from "./dom.js";
import { stamp } from "./format.js";

export class EventsPanel {
  constructor(scene) {
    this._scene = scene;
    this._list = byId("events").querySelector("ol");
    this._empty = byId("events").querySelector(".empty");
    this._keys = new WeakMap();
    this._next = 0;
  }

  update() {
    const { hello } = this._scene;
    const events = this._scene.happened();
    this._empty.hidden = events.length > 0;
    keepChildren(
      this._list, [...events].reverse(), (event) => this._key(event),
      () => make("li", {}, make("time"), make("span")),
      (item, { t, text }) => {
        setText(item.firstChild, stamp(t, hello?.bag));
        setText(item.lastChild, text);
      },
    );
  }

  _key(event) {
    if (!this._keys.has(event)) this._keys.set(event, (this._next += 1));
    return this._keys.get(event);
  }
}
