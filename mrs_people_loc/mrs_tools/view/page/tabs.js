/** The tabs of the panels: one is open; arrow keys go from one to the next. */

import { byId } from "./dom.js";

export class Tabs {
  constructor(onOpen) {
    this.open = "people";
    this._onOpen = onOpen;
    this._tabs = [...document.querySelectorAll("[role=tab]")];
    for (const tab of this._tabs) {
      tab.addEventListener("click", () => this.show(nameOf(tab)));
      tab.addEventListener("keydown", (event) => this._key(event));
    }
  }

  /** Return the names of the tabs that are not hidden. */
  get names() {
    return this._tabs.filter((tab) => !tab.hidden).map(nameOf);
  }

  show(name) {
    if (this.open === name || !this.names.includes(name)) return;
    this.open = name;
    for (const tab of this._tabs) {
      const chosen = nameOf(tab) === name;
      tab.setAttribute("aria-selected", chosen);
      tab.tabIndex = chosen ? 0 : -1;
      byId(nameOf(tab)).hidden = !chosen;
    }
    this._onOpen(name);
  }

  /** Hide or show a tab; if it was open, the first one opens. */
  setHidden(name, hidden) {
    byId(`tab-${name}`).hidden = hidden;
    if (hidden && this.open === name) this.show("people");
  }

  _key(event) {
    const { names } = this;
    const here = names.indexOf(nameOf(event.currentTarget));
    const goal = {
      ArrowRight: (here + 1) % names.length,
      ArrowLeft: (here + names.length - 1) % names.length,
      Home: 0,
      End: names.length - 1,
    }[event.key];
    if (goal === undefined) return;
    event.preventDefault();
    this.show(names[goal]);
    byId(`tab-${names[goal]}`).focus();
  }
}

const nameOf = (tab) => tab.getAttribute("aria-controls");
