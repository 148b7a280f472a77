/** The time line of a recording: play, pause, speed, seek. */

import { byId, setAttribute, setText } from "./dom.js";
import { timeInBag } from "./format.js";

const LONGEST_ANSWER_MS = 1000;

export class Timeline {
  constructor(scene, send) {
    this._scene = scene;
    this._send = send;
    this._slider = byId("seek");
    /** Where the user wants to be, and what was sent of that; seconds since the start. */
    this._wanted = null;
    this._sent = null;
    this._timer = 0;
    this._slider.addEventListener("input", () => this._seekSoon(Number(this._slider.value)));
    byId("play").addEventListener("click", () => this.toggle());
    byId("speed").addEventListener("change", (event) =>
      send({ type: "speed", speed: Number(event.target.value) }),
    );
  }

  /** Play or pause; returns false if there is no recording. */
  toggle() {
    const { time } = this._scene;
    if (!time) return false;
    this._send({ type: time.playing ? "pause" : "play" });
    return true;
  }

  /** Go forwards by seconds. */
  skip(seconds) {
    const { time } = this._scene;
    if (time) this._seekSoon(Math.min(Math.max(time.t + seconds, time.start), time.end) - time.start);
  }

  update() {
    const { time } = this._scene;
    byId("timeline").hidden = !time;
    if (!time) return;
    const play = byId("play");
    setAttribute(play, "aria-label", time.playing ? "Pause" : "Play");
    setAttribute(play, "data-playing", time.playing ? "" : null);
    const length = time.end - time.start;
    setAttribute(this._slider, "max", length.toFixed(1));
    const shown = this._wanted ?? time.t - time.start;
    if (this._wanted === null) this._slider.value = shown;
    const [now, whole] = byId("time").children;
    setText(now, timeInBag(shown));
    setText(whole, ` / ${timeInBag(length)}`);
    setAttribute(this._slider, "aria-valuetext", `${timeInBag(shown)} of ${timeInBag(length)}`);
    this._showSpeed(time.speed);
    byId("ready").hidden = time.ready >= time.end;
    setText(byId("ready"), `Finding people in the recording: done until ${timeInBag(time.ready - time.start)}`);
  }

  _showSpeed(speed) {
    const select = byId("speed");
    if (document.activeElement === select || Number(select.value) === speed) return;
    if (![...select.options].some(({ value }) => Number(value) === speed)) {
      select.add(new Option(`${speed}×`, String(speed)));
    }
    select.value = String(speed);
  }

  /** The server has answered a command: the next seek may be sent. */
  answered() {
    clearTimeout(this._timer);
    this._timer = 0;
    if (this._wanted === this._sent) this._wanted = null;
    else this._sendSeek();
  }

  /** Seek now, or when the seek before is answered; the last wish counts. */
  _seekSoon(offset) {
    this._wanted = offset;
    this.update();
    if (!this._timer) this._sendSeek();
  }

  _sendSeek() {
    if (this._wanted === null) return;
    this._sent = this._wanted;
    this._timer = setTimeout(() => this.answered(), LONGEST_ANSWER_MS);
    this._send({ type: "seek", t: this._scene.time.start + this._sent });
  }
}
