/** The map: its view (zoom, moving, following), what is clicked, and when it is drawn. */

import { mapColours } from "./colours.js";
import * as draw from "./draw.js";
import { mainGroup } from "./scene.js";

const SMALLEST_SCALE = 2;
const LARGEST_SCALE = 400;
/** Fitting shows at least this many metres, so that one person does not fill the map. */
const SMALLEST_FIT_M = 7;
const MARGIN_M = 0.5;
/** Of the signs of what is fitted to the edges of the map: there are buttons, and the scale. */
const INSET_PX = { right: 58, bottom: 32, left: 12 };
/** Walls and grids are fitted whole where a metre has this many pixels then; else people and robots. */
const SMALLEST_MAP_SCALE = 20;
const FOLLOW_SCALE = 60;
const TAP_PX = 24;
const DRAG_PX = 6;
const GLIDE_MS = 140;

export class MapView {
  /**
   * Draw `scene` on the canvas in `element`. `onSelect({person} | {robot} | {})` is called for what is
   * clicked, `onMode()` when fitting or following begins or ends.
   */
  constructor(element, scene, { onSelect, onMode }) {
    this.element = element;
    this.canvas = element.querySelector("canvas");
    this.scene = scene;
    this.view = { x: 0, y: 0, scale: 40, width: 1, height: 1 };
    /** "fit": everything stays in view; "follow": the group or the selected person; "free". */
    this.mode = "fit";
    this.cells = false;
    /** What is fitted stays below this row of the canvas. */
    this.insetTop = 12;
    this.selected = {};
    this._onSelect = onSelect;
    this._onMode = onMode;
    this._context = this.canvas.getContext("2d");
    this._colours = mapColours();
    this._labels = new draw.Labels();
    this._goal = undefined;
    this._fitted = false;
    this._grid = null;
    this._frame = 0;
    this._drawnAt = 0;
    this._pointers = new Map();
    this._dragged = 0;
    new ResizeObserver(() => this._resize()).observe(element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this._recolour());
    this._listen();
  }

  /** Draw soon; many calls before the next frame are one. */
  invalidate() {
    if (!this._frame) this._frame = requestAnimationFrame((now) => this._draw(now));
  }

  setMode(mode) {
    if (this.mode === mode) mode = mode === "follow" ? "free" : mode;
    if (mode === "follow" && this.view.scale < FOLLOW_SCALE) this._zoomTo = FOLLOW_SCALE;
    this.mode = mode;
    this._onMode();
    this.invalidate();
  }

  /** Zoom by a factor around a place of the canvas, by default its middle. */
  zoom(factor, column = this.view.width / 2, row = this.view.height / 2) {
    const { view } = this;
    const scale = Math.min(LARGEST_SCALE, Math.max(SMALLEST_SCALE, view.scale * factor));
    const [dx, dy] = [column - view.width / 2, view.height / 2 - row];
    this._zoomTo = undefined;
    if (this.mode === "fit") this._free();
    if (this.mode === "free") {
      view.x += dx / view.scale - dx / scale;
      view.y += dy / view.scale - dy / scale;
    }
    view.scale = scale;
    this.invalidate();
  }

  /** Move the map by pixels. */
  move(columns, rows) {
    this._free();
    this.view.x -= columns / this.view.scale;
    this.view.y += rows / this.view.scale;
    this.invalidate();
  }

  /** Keep what is fitted below the things that cover so many pixels at the top. */
  setInsetTop(pixels) {
    const inset = Math.min(pixels + 12, this.view.height / 2);
    if (inset === this.insetTop) return;
    this.insetTop = inset;
    this._goal = undefined;
    this.invalidate();
  }

  /** Return the place on the canvas of a place in metres. */
  place(x, y) {
    const { view } = this;
    return [view.width / 2 + (x - view.x) * view.scale, view.height / 2 - (y - view.y) * view.scale];
  }

  /** Take the walls and the grid of the scene again. */
  async takeMap() {
    const grid = this.scene.map?.grid ?? null;
    let picture = null;
    if (grid) {
      const image = new Image();
      image.src = `data:image/png;base64,${grid.png}`;
      await image.decode().then(() => (picture = image), () => null); // a broken picture: no grid
    }
    this._grid = grid && picture && { grid, picture, coloured: this._colourGrid(picture) };
    this.invalidate();
  }

  _free() {
    if (this.mode === "free") return;
    this.mode = "free";
    this._zoomTo = undefined;
    this._onMode();
  }

  _recolour() {
    this._colours = mapColours();
    if (this._grid) this._grid.coloured = this._colourGrid(this._grid.picture);
    this.invalidate();
  }

  /** Return the grid in the colours of the page: occupied opaque, unknown shaded, free transparent. */
  _colourGrid(picture) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [picture.naturalWidth, picture.naturalHeight];
    const context = canvas.getContext("2d", { willReadFrequently: true });
    const [block, unknown] = ["block", "unknown"].map((name) => {
      context.fillStyle = this._colours[name];
      context.fillRect(0, 0, 1, 1);
      return context.getImageData(0, 0, 1, 1).data;
    });
    context.clearRect(0, 0, 1, 1);
    context.drawImage(picture, 0, 0);
    const pixels = context.getImageData(0, 0, canvas.width, canvas.height);
    const words = new Uint32Array(pixels.data.buffer);
    const word = (colour) => new Uint32Array(colour.buffer)[0];
    const [blockWord, unknownWord] = [word(block), word(unknown)];
    for (let i = 0; i < words.length; i += 1) {
      const grey = words[i] & 255;
      words[i] = grey < 128 ? blockWord : grey < 230 ? unknownWord : 0;
    }
    context.putImageData(pixels, 0, 0);
    return canvas;
  }

  _resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    const density = Math.min(2, devicePixelRatio || 1);
    Object.assign(this.view, { width, height });
    [this.canvas.width, this.canvas.height] = [Math.round(width * density), Math.round(height * density)];
    this._context.setTransform(density, 0, 0, density, 0, 0);
    this._fitted = false;
    cancelAnimationFrame(this._frame);
    this._draw(performance.now()); // at once: a canvas that was resized is empty
  }

  _draw(now) {
    this._frame = 0;
    const shown = this.scene.shown(now);
    const glides = this._aim(shown, now);
    this._paint(shown);
    if (glides || this.scene.moves(now)) this.invalidate();
  }

  _paint({ people, groups, robots }) {
    const { view, scene, selected, _context: context, _colours: colours } = this;
    context.fillStyle = colours.back;
    context.fillRect(0, 0, view.width, view.height);
    draw.drawRaster(context, view, colours);
    if (this._grid) draw.drawGrid(context, view, this._grid.grid, this._grid.coloured);
    for (const robot of robots) draw.drawView(context, view, colours, robot);
    draw.drawWalls(context, view, colours, scene.map?.walls ?? []);
    if (this.cells && scene.cells) {
      draw.drawCells(context, view, colours, scene.cells.robots, selected.robot);
    }
    for (const post of scene.state?.tour?.posts ?? []) {
      draw.drawPost(context, view, colours, post, robots.find(({ name }) => name === post.robot));
    }
    for (const person of people) {
      const trail = scene.trails.get(person.id);
      if (trail) draw.drawTrail(context, view, colours, person, trail);
    }
    for (const group of groups) draw.drawGroup(context, view, colours, group, people);
    for (const robot of robots) {
      draw.drawRobot(context, view, colours, robot, robot.name === selected.robot);
    }
    for (const person of people) {
      draw.drawPerson(context, view, colours, person, person.id !== 0 && person.id === selected.person);
    }
    draw.drawTruth(context, view, colours, scene.state?.truth ?? []);
    this._labels.draw(
      context, view, colours, { people, robots }, scene.behind, view.width - INSET_PX.right,
    );
    draw.drawScale(context, view, colours);
  }

  /** Move the view to what it fits or follows; returns whether it is still on the way. */
  _aim(shown, now) {
    const elapsed = now - this._drawnAt;
    this._drawnAt = now;
    const goal = this.mode === "fit" ? this._fit(shown) : this.mode === "follow" && this._follow(shown);
    if (!goal) return false;
    const { view } = this;
    const share = this.scene.smooth && this._fitted ? 1 - Math.exp(-Math.min(elapsed, 100) / GLIDE_MS) : 1;
    this._fitted = true;
    const rest = Math.hypot(goal.x - view.x, goal.y - view.y) * view.scale;
    const ratio = goal.scale / view.scale;
    if (rest < 0.5 && Math.abs(ratio - 1) < 0.002) return false;
    view.x += (goal.x - view.x) * share;
    view.y += (goal.y - view.y) * share;
    view.scale *= ratio ** share;
    return share < 1;
  }

  _follow({ people, groups }) {
    const followed = people.find(({ id }) => id !== 0 && id === this.selected.person) ?? mainGroup(groups);
    return followed && { x: followed.x, y: followed.y, scale: this._zoomTo ?? this.view.scale };
  }

  /** Return the view of everything: kept while all of that is in it and fills half of it. */
  _fit({ people, robots }) {
    const movers = [...people, ...robots, ...(this.scene.state?.tour?.posts ?? [])];
    let box = boxOf(movers.map(({ x, y }) => [x, y]));
    const whole = boxOf([...movers.map(({ x, y }) => [x, y]), ...this._corners()]);
    if (whole && (!box || this._scaleOf(whole) >= SMALLEST_MAP_SCALE)) box = whole;
    if (!box) return undefined;
    const scale = this._scaleOf(box);
    if (this._fitted && this._goal && this._keeps(this._goal, box, scale)) return this._goal;
    this._goal = {
      x: (box[0] + box[2]) / 2 + (INSET_PX.right - INSET_PX.left) / 2 / scale,
      y: (box[1] + box[3]) / 2 + (this.insetTop - INSET_PX.bottom) / 2 / scale,
      scale,
    };
    return this._goal;
  }

  /** Return the scale at which a box fits [px/m]. */
  _scaleOf(box) {
    const needed = [box[2] - box[0] + 2 * MARGIN_M, box[3] - box[1] + 2 * MARGIN_M].map((length) =>
      Math.max(length, SMALLEST_FIT_M),
    );
    const { width, height } = this.view;
    const signs = 2 * draw.robotSize(SMALLEST_SCALE);
    const free = [
      width - INSET_PX.left - INSET_PX.right - signs, height - this.insetTop - INSET_PX.bottom - signs,
    ];
    return Math.max(SMALLEST_SCALE, Math.min(LARGEST_SCALE, free[0] / needed[0], free[1] / needed[1]));
  }

  /** Return whether a box is free in view with that goal, and is not small there; `scale` would fit it best. */
  _keeps(goal, box, scale) {
    const { width, height } = this.view;
    const sign = draw.robotSize(goal.scale);
    const [right, up] = [width, height].map((length) => (length / 2 - sign) / goal.scale);
    return (
      goal.scale >= 0.6 * scale && goal.scale <= 1.1 * scale &&
      box[0] >= goal.x - right + INSET_PX.left / goal.scale &&
      box[2] <= goal.x + right - INSET_PX.right / goal.scale &&
      box[1] >= goal.y - up + INSET_PX.bottom / goal.scale &&
      box[3] <= goal.y + up - this.insetTop / goal.scale
    );
  }

  _corners() {
    const walls = (this.scene.map?.walls ?? []).flatMap(([x1, y1, x2, y2]) => [[x1, y1], [x2, y2]]);
    const grid = this.scene.map?.grid;
    if (!grid) return walls;
    const [cos, sin] = [Math.cos(grid.yaw), Math.sin(grid.yaw)];
    const [width, height] = [grid.width * grid.resolution, grid.height * grid.resolution];
    const corners = [[0, 0], [width, 0], [0, height], [width, height]];
    return [...walls, ...corners.map(([x, y]) => [grid.x + x * cos - y * sin, grid.y + x * sin + y * cos])];
  }

  _listen() {
    const { element } = this;
    element.addEventListener("wheel", (event) => {
      event.preventDefault();
      const [column, row] = this._local(event);
      this.zoom(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), column, row);
    }, { passive: false });
    element.addEventListener("pointerdown", (event) => {
      element.setPointerCapture(event.pointerId);
      this._pointers.set(event.pointerId, this._local(event));
      if (this._pointers.size === 1) this._dragged = 0;
    });
    element.addEventListener("pointermove", (event) => {
      if (this._pointers.has(event.pointerId)) this._drag(event.pointerId, this._local(event));
    });
    element.addEventListener("pointerup", (event) => {
      const tap = this._pointers.size === 1 && this._dragged < DRAG_PX;
      if (this._pointers.delete(event.pointerId) && tap) this._tap(...this._local(event));
    });
    element.addEventListener("pointercancel", (event) => this._pointers.delete(event.pointerId));
    element.addEventListener("keydown", (event) => this._key(event));
  }

  _local(event) {
    const box = this.element.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  }

  /** Move by one pointer; by two zoom and move, around their middle. */
  _drag(id, place) {
    const before = [...this._pointers.values()];
    const from = this._pointers.get(id);
    this._pointers.set(id, place);
    const after = [...this._pointers.values()];
    this._dragged += Math.hypot(place[0] - from[0], place[1] - from[1]);
    if (before.length > 2 || this._dragged < DRAG_PX) return;
    const [middleBefore, middle] = [middleOf(before), middleOf(after)];
    if (before.length === 2) this.zoom(span(after) / Math.max(1, span(before)), ...middle);
    this.move(middle[0] - middleBefore[0], middle[1] - middleBefore[1]);
  }

  _tap(column, row) {
    const { people, robots } = this.scene.shown(performance.now());
    const candidates = [
      ...people.filter(({ id }) => id !== 0).map((item) => ({ item, found: { person: item.id } })),
      ...robots.map((item) => ({ item, found: { robot: item.name } })),
    ].map(({ item, found }) => {
      const [x, y] = this.place(item.x, item.y);
      return { found, distance: Math.hypot(x - column, y - row) };
    });
    const nearest = candidates.reduce((a, b) => (b.distance < a.distance ? b : a), {
      found: {}, distance: TAP_PX,
    });
    this._onSelect(nearest.found);
  }

  _key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const step = Math.min(this.view.width, this.view.height) / 8;
    const actions = {
      ArrowLeft: () => this.move(step, 0),
      ArrowRight: () => this.move(-step, 0),
      ArrowUp: () => this.move(0, step),
      ArrowDown: () => this.move(0, -step),
      "+": () => this.zoom(1.25),
      "=": () => this.zoom(1.25),
      "-": () => this.zoom(0.8),
      0: () => this.setMode("fit"),
    };
    if (!(event.key in actions)) return;
    actions[event.key]();
    event.preventDefault();
    event.stopPropagation();
  }
}

/** Return [left, lower, right, upper] of points, or undefined. */
function boxOf(points) {
  if (!points.length) return undefined;
  return points.reduce(
    ([left, lower, right, upper], [x, y]) => [
      Math.min(left, x), Math.min(lower, y), Math.max(right, x), Math.max(upper, y),
    ],
    [Infinity, Infinity, -Infinity, -Infinity],
  );
}

const middleOf = (points) => [0, 1].map((axis) => points.reduce((sum, p) => sum + p[axis], 0) / points.length);
const span = ([a, b]) => Math.hypot(a[0] - b[0], a[1] - b[1]);
