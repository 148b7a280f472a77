/** What a screen reader is told: little, and never faster than it can be listened to. */

import { byId, setText } from "./dom.js";

const PAUSE_MS = 4000;

export class Announcer {
  constructor() {
    this._waiting = new Set();
    this._timer = 0;
  }

  /** Say a sentence; those that come together are said together. */
  say(sentence) {
    this._waiting.add(sentence);
    if (!this._timer) this._speak();
  }

  _speak() {
    const sentences = [...this._waiting];
    this._waiting.clear();
    this._timer = 0;
    if (!sentences.length) return;
    setText(byId("announcer"), sentences.join(" "));
    this._timer = setTimeout(() => this._speak(), PAUSE_MS);
  }
}
