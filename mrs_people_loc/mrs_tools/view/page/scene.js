/** What the server has told, the trails of people, and where everything is between two states. */

import { behind } from "./format.js";

const TRAIL_S = 8;
const TRAIL_STEP_M = 0.05;
/** A step of time backwards, or forwards by more than this, is a jump: nothing is drawn between. */
const JUMP_S = 3;
const LONGEST_BLEND_MS = 400;
/** People who came longer ago than this are old. */
const OLD_S = 2;
const LAST_EVENTS = 200;

/** Who is not followed has the id 0, which several people may have at once. */
const NOBODY = "person 0";

/** Return what a person, group or robot is recognized by in the next state. */
function keyOf(item) {
  if (item.name !== undefined) return `robot ${item.name}`;
  return `${item.members ? "group" : "person"} ${item.id}`;
}

const mix = (from, to, share) => from + (to - from) * share;

function mixAngle(from, to, share) {
  return from + Math.atan2(Math.sin(to - from), Math.cos(to - from)) * share;
}

/** Return `to` with the positions (and angles) of the way from `from` to it. */
function between(from, to, share) {
  if (!from || share >= 1) return to;
  const shown = { ...to, x: mix(from.x, to.x, share), y: mix(from.y, to.y, share) };
  if (to.yaw !== undefined) shown.yaw = mixAngle(from.yaw, to.yaw, share);
  return shown;
}

export class Scene {
  constructor() {
    this.hello = null;
    this.map = null;
    this.state = null;
    this.cells = null;
    this.images = new Map();
    this.events = [];
    this.health = null;
    this.time = null;
    /** Person's id -> points [t, x, y], oldest first. */
    this.trails = new Map();
    /** Straggler's id -> "behind 12 s", the same everywhere: renewed with the texts of the page. */
    this.behind = new Map();
    /** When the last state came, in ms of performance.now(). */
    this.stateAt = -Infinity;
    /** Whether positions are drawn between two states; otherwise they step. */
    this.smooth = true;
    this._from = new Map();
    this._blendMs = 0;
  }

  /** Take a message of the server. */
  apply(message, now) {
    switch (message.type) {
      case "hello":
        this.hello = message;
        this.events = [];
        this.images.clear();
        break;
      case "state":
        this._takeState(message, now);
        break;
      case "image":
        this.images.set(message.robot, message);
        break;
      case "event":
        this._takeEvent(message);
        break;
      case "map":
      case "cells":
      case "health":
      case "time":
        this[message.type] = message;
        break;
    }
  }

  /** Return for how long no people have come, in seconds: of a recording, at its time; 0: they are not old. */
  silence(now) {
    const silent = (this.state?.age ?? 0) + this.stateAge(now);
    return this.state && silent > OLD_S ? silent : 0;
  }

  /** Return how long ago the last state came, in seconds; 0: of a recording, which may stand still. */
  stateAge(now) {
    return this.hello?.mode === "bag" ? 0 : (now - this.stateAt) / 1000;
  }

  person(id) {
    return this.state?.people.find((person) => person.id === id);
  }

  robot(name) {
    return this.state?.robots.find((robot) => robot.name === name);
  }

  /** Renew what is said of stragglers; returns whether it has changed. */
  renewBehind() {
    const stragglers = (this.state?.people ?? []).filter(({ straggler }) => straggler);
    const before = JSON.stringify([...this.behind]);
    this.behind = new Map(stragglers.map((person) => [person.id, behind(person)]));
    return JSON.stringify([...this.behind]) !== before;
  }

  /** Return the events, the oldest first: of a recording, those that have happened at its time. */
  happened() {
    if (this.hello?.mode !== "bag" || !this.time) return this.events;
    return this.events.filter(({ t }) => t <= this.time.t);
  }

  /** Return whether positions still change without a new message. */
  moves(now) {
    return now < this.stateAt + this._blendMs;
  }

  /** Return people, groups and robots as they are drawn at `now`. */
  shown(now) {
    if (!this.state) return { people: [], groups: [], robots: [] };
    const share = this.moves(now) ? (now - this.stateAt) / this._blendMs : 1;
    const blend = (item) => between(this._from.get(keyOf(item)), item, share);
    return {
      people: this.state.people.map(blend),
      groups: this.state.groups.map(blend),
      robots: this.state.robots.map(blend),
    };
  }

  _takeState(state, now) {
    const before = this.state;
    const jump = !before || !(state.t >= before.t) || state.t > before.t + JUMP_S;
    const wait = now - this.stateAt;
    this._from.clear();
    if (jump) {
      this.trails.clear();
      this.cells = null;
    } else if (this.smooth) {
      for (const items of Object.values(this.shown(now))) {
        for (const item of items) this._from.set(keyOf(item), item);
      }
      this._from.delete(NOBODY);
    }
    if (state.trails) {
      this.trails = new Map(Object.entries(state.trails).map(([id, trail]) => [Number(id), trail]));
    } else if (before && !jump) {
      this._lengthenTrails(before, state.t);
    }
    this._blendMs = jump || !this.smooth ? 0 : Math.min(wait, LONGEST_BLEND_MS);
    this.stateAt = now;
    this.state = state;
  }

  /** Of a recording, events come again after a seek. */
  _takeEvent(event) {
    if (this.hello?.mode === "bag") {
      if (this.events.some(({ t, text }) => t === event.t && text === event.text)) return;
      this.events.push(event);
      this.events.sort((a, b) => a.t - b.t);
    } else {
      this.events.push(event);
    }
    this.events.splice(0, this.events.length - LAST_EVENTS);
  }

  /** Trails end at the state before, which is where the blending starts. */
  _lengthenTrails(before, t) {
    for (const { id, x, y } of before.people) {
      if (id === 0) continue;
      if (!this.trails.has(id)) this.trails.set(id, []);
      const trail = this.trails.get(id);
      const last = trail.at(-1);
      if (!last || Math.hypot(x - last[1], y - last[2]) >= TRAIL_STEP_M) trail.push([before.t, x, y]);
    }
    for (const [id, trail] of this.trails) {
      while (trail.length && trail[0][0] < t - TRAIL_S) trail.shift();
      if (!trail.length) this.trails.delete(id);
    }
  }
}

/** Return the largest group of a state, or undefined. */
export function mainGroup(groups) {
  return groups.reduce((a, b) => (a && a.members.length >= b.members.length ? a : b), undefined);
}
