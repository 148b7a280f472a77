/** The panel of robots: their state, and on demand what they see. */

import { byId, keepChildren, make, reveal, setAttribute, setText } from "./dom.js";
import { duration, fixed } from "./format.js";

/** An image that is older than this beside the people is said to be old. */
const OLD_IMAGE_S = 2;
const OLD_POSE_S = 2;

export class RobotsPanel {
  /** `onLook()` is called when the robots whose images are wanted change. */
  constructor(scene, { onLook, onSelect }) {
    this.open = new Set();
    this._scene = scene;
    this._onLook = onLook;
    this._onSelect = onSelect;
    this._list = byId("robots").querySelector("ul");
    this._empty = byId("robots").querySelector(".empty");
  }

  update(selected) {
    const robots = this._scene.state?.robots ?? [];
    this._empty.hidden = robots.length > 0;
    keepChildren(
      this._list, robots, ({ name }) => name,
      ({ name }) => this._create(name),
      (card, robot) => this._update(card, robot, robot.name === selected.robot),
    );
  }

  /** Scroll the card of a robot into view. */
  reveal(name) {
    reveal([...this._list.children].find(({ dataset }) => dataset.key === name));
  }

  /** Forget images, so that none is shown that is no longer asked for. */
  clearImages() {
    this._scene.images.clear();
    for (const picture of this._list.querySelectorAll("img")) {
      picture.removeAttribute("src");
      picture.hidden = true;
    }
  }

  _create(name) {
    const title = make("button", { type: "button", class: "select", "aria-pressed": "false" }, name);
    title.addEventListener("click", () => this._onSelect(name));
    const toggle = make("button", { type: "button", class: "toggle", "aria-expanded": "false", "aria-label": `Camera of ${name}` }, "Camera");
    const pictures = make(
      "div", { class: "pictures", hidden: true },
      make("p", { class: "hint" }, "Waiting for an image"),
      make("img", { alt: `Camera image of ${name}; boxes are the bodies found`, hidden: true }),
      make("img", { alt: `Disparity of ${name}`, hidden: true }),
    );
    toggle.addEventListener("click", () => {
      const opens = !this.open.delete(name);
      if (opens) this.open.add(name);
      toggle.setAttribute("aria-expanded", opens);
      pictures.hidden = !opens;
      this._scene.images.delete(name);
      this._showImages(pictures, name);
      this._onLook();
    });
    return make(
      "li", {},
      make("div", { class: "head" }, make("h2", {}, title), toggle),
      make("p", { class: "state" }), make("p", { class: "facts" }), pictures,
    );
  }

  _update(card, robot, selected) {
    const [head, state, facts, pictures] = card.children;
    setAttribute(card, "class", selected ? "selected" : null);
    setAttribute(head.querySelector(".select"), "aria-pressed", selected);
    const age = robot.age + this._scene.stateAge(performance.now());
    const old = age > OLD_POSE_S;
    setAttribute(state, "data-level", robot.ok && !old ? "ok" : robot.ok ? "warning" : "error");
    const well = old ? `No pose for ${duration(age)}` : "Well";
    setText(state, robot.ok ? well : robot.note || "Not well");
    const [xx, , yy] = robot.cov;
    const sigma = xx === null || yy === null ? "" : ` ± ${fixed(Math.sqrt((xx + yy) / 2), 2)} m`;
    const turn = robot.yaw_sigma === null ? "" : ` ± ${fixed((robot.yaw_sigma * 180) / Math.PI, 1)}°`;
    setText(
      facts,
      `At ${fixed(robot.x, 2)}, ${fixed(robot.y, 2)}${sigma}, heading ${fixed((robot.yaw * 180) / Math.PI, 0)}°${turn}`,
    );
    if (!pictures.hidden) this._showImages(pictures, robot.name);
  }

  _showImages(pictures, name) {
    const [hint, left, disparity] = pictures.children;
    const message = this._scene.images.get(name);
    const now = this._scene.state?.t ?? null;
    const age = message?.t != null && now !== null ? now - message.t : 0;
    const lacking = message ? message.note : "Waiting for an image";
    setText(hint, age > OLD_IMAGE_S ? `This image is ${duration(age)} old. ${lacking}` : lacking);
    hint.hidden = !hint.textContent;
    for (const [picture, data] of [[left, message?.image], [disparity, message?.disparity]]) {
      picture.hidden = !data;
      setAttribute(picture, "src", data ? `data:image/jpeg;base64,${data}` : null);
    }
  }
}
