/** Drawing on the map's canvas. Lengths in pixels of the page; places in metres, through the view. */

import { groupColour } from "./colours.js";

/** Of a normal distribution in two dimensions, 95 % are within this many sigmas. */
const SIGMAS_95 = Math.sqrt(5.991);
const PERSON_RADIUS_M = 0.16;
/** Signs are no smaller than this, however far the map is zoomed out. */
const PERSON_PX = 5.5;
const ROBOT_PX = 12;
const ROBOT_M = 0.3;
const TRUTH_PX = 4;
const LONGEST_ELLIPSE_M = 20;
const OUTDATED_S = 2;
/** A name that is cut off by the edge is as bad as this area of a covered one. */
const OUTSIDE_PX2 = 500;
const FONT = "system-ui, -apple-system, 'Segoe UI', Roboto, 'DejaVu Sans', sans-serif";

/** Place of a point on the canvas. */
const at = (view, x, y) => [
  view.width / 2 + (x - view.x) * view.scale,
  view.height / 2 - (y - view.y) * view.scale,
];

function path(context, view, points) {
  context.beginPath();
  for (const [x, y] of points) context.lineTo(...at(view, x, y));
}

/** Draw lines with a distance of a round number of metres. */
export function drawRaster(context, view, colours) {
  const step = [1, 2, 5, 10, 20, 50, 100].find((metres) => metres * view.scale >= 28) ?? 200;
  const half = [view.width / 2 / view.scale, view.height / 2 / view.scale];
  context.strokeStyle = colours.line;
  context.lineWidth = 1;
  context.beginPath();
  for (let x = Math.ceil((view.x - half[0]) / step) * step; x <= view.x + half[0]; x += step) {
    const column = Math.round(at(view, x, 0)[0]) + 0.5;
    context.moveTo(column, 0);
    context.lineTo(column, view.height);
  }
  for (let y = Math.ceil((view.y - half[1]) / step) * step; y <= view.y + half[1]; y += step) {
    const row = Math.round(at(view, 0, y)[1]) + 0.5;
    context.moveTo(0, row);
    context.lineTo(view.width, row);
  }
  context.stroke();
}

/** Draw an occupancy grid whose picture has the colours of the page already. */
export function drawGrid(context, view, grid, picture) {
  const scale = grid.resolution * view.scale;
  context.save();
  context.translate(...at(view, grid.x, grid.y));
  context.rotate(-grid.yaw);
  context.imageSmoothingEnabled = scale < 1;
  context.drawImage(picture, 0, -grid.height * scale, grid.width * scale, grid.height * scale);
  context.restore();
}

export function drawWalls(context, view, colours, walls) {
  context.strokeStyle = colours.wall;
  context.lineWidth = Math.max(2, 0.06 * view.scale);
  context.lineCap = "round";
  context.beginPath();
  for (const [x1, y1, x2, y2] of walls) {
    context.moveTo(...at(view, x1, y1));
    context.lineTo(...at(view, x2, y2));
  }
  context.stroke();
}

/** Draw cells as points; those of the selected robot in the colour of the selection. */
export function drawCells(context, view, colours, robots, selected) {
  const size = Math.min(5, Math.max(2, 0.05 * view.scale));
  for (const [name, places] of Object.entries(robots)) {
    context.fillStyle = name === selected ? colours.select : colours.cell;
    for (let i = 0; i + 1 < places.length; i += 2) {
      const [column, row] = at(view, places[i], places[i + 1]);
      context.fillRect(column - size / 2, row - size / 2, size, size);
    }
  }
}

/** Add the ellipse in which a place is 95 % likely to be to the path; false if that is not known. */
function ellipse(context, view, { x, y, cov }) {
  const [xx, xy, yy] = cov;
  if (xx === null || xy === null || yy === null) return false;
  const mean = (xx + yy) / 2;
  const spread = Math.hypot((xx - yy) / 2, xy);
  const [long, short] = [mean + spread, mean - spread].map(
    (variance) => Math.min(SIGMAS_95 * Math.sqrt(Math.max(0, variance)), LONGEST_ELLIPSE_M) * view.scale,
  );
  context.beginPath();
  context.ellipse(...at(view, x, y), long, short, -0.5 * Math.atan2(2 * xy, xx - yy), 0, 2 * Math.PI);
  return true;
}

/** Draw what a robot sees, as a sector. */
export function drawView(context, view, colours, robot) {
  if (robot.reach === null || robot.view === null) return;
  const middle = -(robot.yaw + (robot.view_yaw ?? 0));
  const [column, row] = at(view, robot.x, robot.y);
  context.beginPath();
  context.moveTo(column, row);
  context.arc(column, row, robot.reach * view.scale, middle - robot.view / 2, middle + robot.view / 2);
  context.closePath();
  context.fillStyle = colours.view;
  context.globalAlpha = robot.age > OUTDATED_S ? 0.03 : 0.1;
  context.fill();
  context.globalAlpha = 0.3;
  context.lineWidth = 1;
  context.strokeStyle = colours.view;
  context.stroke();
  context.globalAlpha = 1;
}

/** Return how far the sign of a robot reaches from its place, the largest of all signs, in pixels. */
export const robotSize = (scale) => Math.max(ROBOT_PX, ROBOT_M * scale);

/** Draw a robot: a triangle that points forward; hollow and dashed when its pose is old or it is not well. */
export function drawRobot(context, view, colours, robot, selected) {
  const colour = selected ? colours.select : colours.robot;
  if (ellipse(context, view, robot)) {
    context.fillStyle = context.strokeStyle = colour;
    context.globalAlpha = 0.15;
    context.fill();
    context.globalAlpha = 0.7;
    context.lineWidth = 1;
    context.stroke();
    context.globalAlpha = 1;
  }
  const [column, row] = at(view, robot.x, robot.y);
  const size = robotSize(view.scale);
  context.save();
  context.translate(column, row);
  context.rotate(-robot.yaw);
  context.beginPath();
  context.moveTo(size, 0);
  context.lineTo(-0.75 * size, 0.7 * size);
  context.lineTo(-0.45 * size, 0);
  context.lineTo(-0.75 * size, -0.7 * size);
  context.closePath();
  context.lineWidth = 2;
  context.lineJoin = "round";
  const well = robot.ok && robot.age <= OUTDATED_S;
  context.fillStyle = well ? colour : colours.back;
  context.strokeStyle = well ? colours.halo : colour;
  context.setLineDash(well ? [] : [4, 3]);
  context.fill();
  context.stroke();
  context.restore();
  if (selected) ring(context, column, row, 1.25 * size + 4, colours.select, []);
}

/** Draw where a robot belongs in a tour, and a line from there to the robot. */
export function drawPost(context, view, colours, post, robot) {
  const [column, row] = at(view, post.x, post.y);
  const radius = Math.max(6, 0.2 * view.scale);
  context.strokeStyle = colours.post;
  context.lineWidth = 2;
  context.beginPath();
  context.arc(column, row, radius, 0, 2 * Math.PI);
  context.moveTo(column, row);
  context.lineTo(column + 1.7 * radius * Math.cos(post.yaw), row - 1.7 * radius * Math.sin(post.yaw));
  context.stroke();
  if (!robot) return;
  context.lineWidth = 1;
  context.setLineDash([2, 4]);
  path(context, view, [[post.x, post.y], [robot.x, robot.y]]);
  context.stroke();
  context.setLineDash([]);
}

/** Draw where people truly are, as diamonds. */
export function drawTruth(context, view, colours, places) {
  context.strokeStyle = colours.label;
  context.lineWidth = 1.5;
  context.beginPath();
  for (const [x, y] of places) {
    const [column, row] = at(view, x, y);
    context.moveTo(column, row - TRUTH_PX);
    for (const [right, down] of [[1, 0], [0, 1], [-1, 0], [0, -1]]) {
      context.lineTo(column + right * TRUTH_PX, row + down * TRUTH_PX);
    }
  }
  context.stroke();
}

/** Draw the centre of a group and its links to those who belong to it. */
export function drawGroup(context, view, colours, group, people) {
  const colour = colours[groupColour(group.id)];
  const centre = at(view, group.x, group.y);
  for (const person of people) {
    if (person.group !== group.id || person.id === 0) continue;
    context.strokeStyle = person.straggler ? colours.straggler : colour;
    context.lineWidth = 1.2;
    context.globalAlpha = 0.6;
    context.setLineDash(person.straggler ? [5, 5] : []);
    context.beginPath();
    context.moveTo(...centre);
    context.lineTo(...at(view, person.x, person.y));
    context.stroke();
  }
  context.setLineDash([]);
  context.globalAlpha = 1;
  context.lineWidth = 2.5;
  context.strokeStyle = colour;
  context.beginPath();
  for (const [dx, dy] of [[5, 5], [5, -5]]) {
    context.moveTo(centre[0] - dx, centre[1] - dy);
    context.lineTo(centre[0] + dx, centre[1] + dy);
  }
  context.stroke();
}

/** Draw where a person came from, fading with age; it ends where they are drawn. */
export function drawTrail(context, view, colours, person, trail) {
  context.strokeStyle = colours[person.straggler ? "straggler" : groupColour(person.group)];
  context.lineWidth = 2;
  context.lineCap = "butt";
  const points = [...trail.map(([, x, y]) => [x, y]), [person.x, person.y]];
  for (let i = 1; i < points.length; i += 1) {
    context.globalAlpha = 0.45 * (i / points.length);
    path(context, view, points.slice(i - 1, i + 1));
    context.stroke();
  }
  context.globalAlpha = 1;
}

function ring(context, column, row, radius, colour, dash) {
  context.beginPath();
  context.arc(column, row, radius, 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = 2;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

/** Draw an arrow to where a person is in one second. */
function arrow(context, view, { x, y, vx, vy }, radius, colour) {
  if (vx === null || vy === null) return;
  const [from, to] = [at(view, x, y), at(view, x + vx, y + vy)];
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]);
  if (length < radius + 4) return;
  const [dx, dy] = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
  const head = Math.min(8, 0.5 * length);
  context.strokeStyle = context.fillStyle = colour;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(from[0] + dx * radius, from[1] + dy * radius);
  context.lineTo(to[0] - dx * head * 0.7, to[1] - dy * head * 0.7);
  context.stroke();
  context.beginPath();
  context.moveTo(...to);
  context.lineTo(to[0] - dx * head - dy * head * 0.5, to[1] - dy * head + dx * head * 0.5);
  context.lineTo(to[0] - dx * head + dy * head * 0.5, to[1] - dy * head - dx * head * 0.5);
  context.fill();
}

/** Draw a person; who is not seen just now is hollow, with a dashed ellipse; a straggler has a dashed ring. */
export function drawPerson(context, view, colours, person, selected) {
  const colour = colours[person.straggler ? "straggler" : groupColour(person.group)];
  const [column, row] = at(view, person.x, person.y);
  const radius = Math.max(PERSON_PX, PERSON_RADIUS_M * view.scale);
  if (ellipse(context, view, person)) {
    context.fillStyle = context.strokeStyle = colour;
    context.globalAlpha = 0.13;
    context.fill();
    context.globalAlpha = 0.65;
    context.lineWidth = 1;
    context.setLineDash(person.predicted ? [4, 3] : []);
    context.stroke();
    context.setLineDash([]);
    context.globalAlpha = 1;
  }
  arrow(context, view, person, radius, colour);
  context.beginPath();
  context.arc(column, row, radius, 0, 2 * Math.PI);
  context.fillStyle = person.predicted ? colours.back : colour;
  context.fill();
  context.lineWidth = 2;
  context.strokeStyle = person.predicted ? colour : colours.halo;
  context.stroke();
  if (person.straggler) ring(context, column, row, radius + 6, colours.straggler, [5, 4]);
  if (selected) ring(context, column, row, radius + (person.straggler ? 11 : 6), colours.select, []);
}

/** Return what is written beside a person; `behind`: what is said of stragglers, by id. */
function personLabel(person, behind) {
  const id = person.id === 0 ? "" : String(person.id);
  return person.straggler ? `${id} ${behind.get(person.id) ?? "behind"}` : id;
}

/**
 * Names beside people and robots, where they cover each other least, left of the column `right`; they
 * keep their side. `behind`: see `Scene`.
 */
export class Labels {
  constructor() {
    this._sides = new Map();
  }

  draw(context, view, colours, { people, robots }, behind, right) {
    const items = [
      ...people.map((person) => ({
        key: `p${person.id}`,
        text: personLabel(person, behind),
        place: at(view, person.x, person.y),
        radius: Math.max(PERSON_PX, PERSON_RADIUS_M * view.scale) + (person.straggler ? 8 : 3),
        colour: colours[person.straggler ? "straggler" : "label"],
        font: `600 13px ${FONT}`,
      })),
      ...robots.map((robot) => ({
        key: `r${robot.name}`,
        text: robot.ok ? robot.name : `${robot.name} (!)`,
        place: at(view, robot.x, robot.y),
        radius: robotSize(view.scale) + 2,
        colour: colours.robot,
        font: `12px ${FONT}`,
      })),
    ].filter(({ text }) => text);
    const taken = items.map(({ place: [column, row], radius }) => ({
      left: column - radius, right: column + radius, top: row - radius, bottom: row + radius,
    }));
    const sides = new Map();
    context.textBaseline = "middle";
    context.lineJoin = "round";
    items.forEach((item, index) => {
      context.font = item.font;
      const width = context.measureText(item.text).width;
      const others = taken.filter((_, other) => other !== index);
      const before = this._sides.get(item.key) ?? 0;
      const choices = [before, 0, 1, 2, 3].map((side) => {
        const box = boxBeside(item, side, width);
        const outside = box.left < 0 || box.right > right ? OUTSIDE_PX2 : 0;
        return { side, box, covered: others.reduce((sum, other) => sum + overlap(box, other), outside) };
      });
      const best = choices.reduce((a, b) => (b.covered < a.covered - 20 ? b : a));
      sides.set(item.key, best.side);
      taken.push(best.box);
      const row = (best.box.top + best.box.bottom) / 2;
      context.strokeStyle = colours.halo;
      context.lineWidth = 4;
      context.strokeText(item.text, best.box.left, row);
      context.fillStyle = item.colour;
      context.fillText(item.text, best.box.left, row);
    });
    this._sides = sides;
  }
}

/** Return the box of a text right above, left above, right below or left below. */
function boxBeside({ place: [column, row], radius }, side, width) {
  const left = side % 2 === 0 ? column + 0.8 * radius : column - 0.8 * radius - width;
  const middle = side < 2 ? row - 0.8 * radius - 4 : row + 0.8 * radius + 4;
  return { left, right: left + width, top: middle - 8, bottom: middle + 8 };
}

function overlap(a, b) {
  const width = Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const height = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  return width > 0 && height > 0 ? width * height : 0;
}

/** Draw a scale at the lower left. */
export function drawScale(context, view, colours) {
  const metres = [0.5, 1, 2, 5, 10, 20, 50, 100].find((length) => length * view.scale >= 50) ?? 200;
  const [left, bottom, length] = [14, view.height - 14, metres * view.scale];
  context.strokeStyle = colours.label;
  context.fillStyle = colours.label;
  context.lineWidth = 1.5;
  context.lineCap = "butt";
  context.beginPath();
  context.moveTo(left, bottom - 5);
  context.lineTo(left, bottom);
  context.lineTo(left + length, bottom);
  context.lineTo(left + length, bottom - 5);
  context.stroke();
  context.font = `12px ${FONT}`;
  context.textBaseline = "alphabetic";
  context.fillText(`${metres} m`, left + 6, bottom - 5);
}
