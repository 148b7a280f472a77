/** The WebSocket to the server: connects, and connects again when it is lost. */

const FIRST_PAUSE_MS = 500;
const LONGEST_PAUSE_MS = 8000;

export class Connection {
  /**
   * `onMessage(message)` gets each parsed message, `onChange()` is called when `phase` changes:
   * "connecting", "open" or "waiting" (until `retryAt`, in ms of performance.now()).
   */
  constructor(url, { onMessage, onChange }) {
    this.phase = "connecting";
    this.retryAt = 0;
    this._url = url;
    this._onMessage = onMessage;
    this._onChange = onChange;
    this._pause = FIRST_PAUSE_MS;
    this._timer = 0;
    this._socket = null;
    addEventListener("online", () => this.retry());
    document.addEventListener("visibilitychange", () => document.hidden || this.retry());
  }

  start() {
    this._connect();
  }

  /** Connect at once if it waits to connect again. */
  retry() {
    if (this.phase === "waiting") this._connect();
  }

  /** Send a message; returns whether there was a connection. */
  send(message) {
    if (this.phase !== "open") return false;
    this._socket.send(JSON.stringify(message));
    return true;
  }

  _connect() {
    clearTimeout(this._timer);
    this._set("connecting");
    const socket = new WebSocket(this._url);
    this._socket = socket;
    socket.onopen = () => this._set("open");
    socket.onmessage = ({ data }) => {
      this._pause = FIRST_PAUSE_MS;
      this._onMessage(JSON.parse(data));
    };
    socket.onclose = () => {
      if (socket === this._socket) this._wait();
    };
  }

  _wait() {
    // Viewers that were cut off together do not come back together.
    const pause = this._pause * (0.75 + 0.5 * Math.random());
    this._pause = Math.min(2 * this._pause, LONGEST_PAUSE_MS);
    this.retryAt = performance.now() + pause;
    this._timer = setTimeout(() => this._connect(), pause);
    this._set("waiting");
  }

  _set(phase) {
    this.phase = phase;
    this._onChange();
  }
}
