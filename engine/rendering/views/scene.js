"use strict";
/* A scenario on a canvas: decodes its data once, stores its road as paths by tiles, and draws its road users at any step. */

/* ---------- Transmitted numbers: differences, in cm, mrad and cm/s ---------- */

function summed(differences, unit) {
  const values = new Float64Array(differences.length);
  let sum = 0;
  for (let i = 0; i < differences.length; i++) values[i] = (sum += differences[i]) * unit;
  return values;
}

function pointsOf(line) {
  const points = new Float64Array(line.length);
  let x = 0, y = 0;
  for (let i = 0; i + 1 < line.length; i += 2) {
    points[i] = (x += line[i]) / 100;
    points[i + 1] = (y += line[i + 1]) / 100;
  }
  return points;
}

class Track {
  constructor(data) {
    this.id = data.obstacle_id;
    this.kind = data.kind;
    this.length = data.length_cm / 100;
    this.width = data.width_cm / 100;
    this.first = data.first_step;
    this.stride = data.stride;
    this.driven = data.driven;
    this.x = summed(data.x_cm, 0.01);
    this.y = summed(data.y_cm, 0.01);
    this.heading = summed(data.heading_mrad, 0.001);
    this.speed = summed(data.speed_cmps, 0.01);
    this.last = this.first + this.stride * (this.x.length - 1);
  }

  /* Writes the state at a step, which may be fractional, into `state`; false if the road user is absent. */
  at(step, state) {
    if (step < this.first || step > this.last) return false;
    const place = (step - this.first) / this.stride;
    const i = Math.min(Math.floor(place), this.x.length - 1);
    const j = Math.min(i + 1, this.x.length - 1), share = place - i;
    state.x = this.x[i] + (this.x[j] - this.x[i]) * share;
    state.y = this.y[i] + (this.y[j] - this.y[i]) * share;
    state.heading = this.heading[i] + (this.heading[j] - this.heading[i]) * share;
    state.speed = this.speed[i] + (this.speed[j] - this.speed[i]) * share;
    return true;
  }
}

/* ---------- Colours: those of the style, as the canvas needs them ---------- */

const COLOURS = ["ground", "ink", "muted", "line", "accent", "panel", "field", "road", "road-edge", "lane-line", "direction",
  "pavement", "outline", "halo", "ego", "car", "taxi", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "priorityVehicle",
  "train", "other", "goal_reached", "goal_refused", "collision", "timeout", "goal_missed", "goal_early", "goal_late", "infeasible", "off_road",
  "invalid", "series-0", "series-1", "series-2", "series-3", "series-4", "series-5", "light-red", "light-yellow", "light-green",
  "light-off"];

function palette() {
  const probe = document.createElement("i"), colours = {};
  document.body.append(probe);
  for (const name of COLOURS) {
    probe.style.color = `var(--${name})`;
    colours[name] = getComputedStyle(probe).color;
  }
  probe.remove();
  return colours;
}

/* The colour of a class, or grey if it has no colour. */
const CLASSES = new Set(["car", "taxi", "truck", "bus", "motorcycle", "bicycle", "pedestrian", "priorityVehicle", "train"]);
const classOf = kind => CLASSES.has(kind) ? kind : "other";

/* ---------- The scene ---------- */

const TILE_M = 150;

class Scene {
  constructor(data) {
    this.id = data.scenario_id;
    this.stepS = data.step_s;
    this.origin = data.origin_m;
    this.firstStep = data.first_step;
    this.lastStep = data.last_step;
    this.shown = data.shown_cm.map(value => value / 100);
    this.tracks = data.tracks.map(track => new Track(track));
    this.start = data.start && new Track(data.start);
    this.road = data.road;
    this.lanelets = data.road.lanelets.map(one => ({ id: one.lanelet_id, ...bounded(pointsOf(one.outline)) }));
    this.pavements = data.road.pavements.map(one => bounded(pointsOf(one)));
    this.standing = data.road.standing.map(one => ({ id: one.obstacle_id, kind: one.kind, ...bounded(pointsOf(one.outline)) }));
    this.signals = data.road.signals;
    this.goals = data.road.goals.map(pointsOf);
    this.tiles = this.tiled(data.road);
  }

  /* The road by tiles, so that only the visible part is drawn. */
  tiled(road) {
    const tiles = new Map();
    const add = (layer, points, closed) => {
      const { box } = bounded(points);
      const key = `${Math.floor((box[0] + box[2]) / 2 / TILE_M)},${Math.floor((box[1] + box[3]) / 2 / TILE_M)}`;
      if (!tiles.has(key)) tiles.set(key, { box: [Infinity, Infinity, -Infinity, -Infinity], layers: {} });
      const tile = tiles.get(key);
      tile.box = [Math.min(tile.box[0], box[0]), Math.min(tile.box[1], box[1]), Math.max(tile.box[2], box[2]), Math.max(tile.box[3], box[3])];
      trace(tile.layers[layer] ??= new Path2D(), points, closed);
    };
    for (const lanelet of this.lanelets) add("surface", lanelet.points, true);
    for (const name of ["pavements", "crossings"]) for (const line of road[name]) add(name, pointsOf(line), true);
    for (const name of ["edges", "dividers", "stop_lines"]) for (const line of road[name]) add(name, pointsOf(line), false);
    for (let i = 0; i + 2 < road.arrows.length; i += 3) {
      const x = road.arrows[i] / 100, y = road.arrows[i + 1] / 100, a = road.arrows[i + 2] / 1000;
      const c = Math.cos(a), s = Math.sin(a);
      add("arrows", Float64Array.of(x + 1.1 * c, y + 1.1 * s, x - 0.5 * c - 0.6 * s, y - 0.5 * s + 0.6 * c, x - 0.5 * c + 0.6 * s, y - 0.5 * s - 0.6 * c), true);
    }
    return [...tiles.values()];
  }

  /* All road users of a run, or of the recording; tracks of reactive traffic replace their recordings. */
  tracksOf(drive) {
    if (!drive || !drive.others.length) return this.tracks;
    const moved = new Map(drive.others.map(track => [track.obstacle_id, new Track(track)]));
    const kept = this.tracks.filter(track => !moved.has(track.id));
    return [...kept, ...moved.values()].sort((a, b) => a.id - b.id);
  }

  laneletsAt(x, y) {
    return this.lanelets.filter(one => covers(one, x, y)).map(one => one.id);
  }

  /* The place of a road user in words: lanelets by their ids, pedestrian areas by their kind. */
  groundAt(x, y) {
    const lanelets = this.laneletsAt(x, y);
    return lanelets.length ? lanelets.join(", ") : this.pavements.some(one => covers(one, x, y)) ? "pavement" : "none";
  }
}

function bounded(points) {
  const box = [Infinity, Infinity, -Infinity, -Infinity];
  for (let i = 0; i < points.length; i += 2) {
    box[0] = Math.min(box[0], points[i]);
    box[1] = Math.min(box[1], points[i + 1]);
    box[2] = Math.max(box[2], points[i]);
    box[3] = Math.max(box[3], points[i + 1]);
  }
  return { points, box };
}

function trace(path, points, closed) {
  for (let i = 0; i + 1 < points.length; i += 2) i ? path.lineTo(points[i], points[i + 1]) : path.moveTo(points[i], points[i + 1]);
  if (closed && points.length) path.closePath();
}

const inBox = (box, x, y) => box[0] <= x && x <= box[2] && box[1] <= y && y <= box[3];

const covers = (one, x, y) => inBox(one.box, x, y) && inPolygon(one.points, x, y);

function inPolygon(points, x, y) {
  let inside = false;
  for (let i = 0, j = points.length - 2; i < points.length; j = i, i += 2) {
    const above = points[i + 1] > y;
    if (above !== points[j + 1] > y && x < (points[j] - points[i]) * (y - points[i + 1]) / (points[j + 1] - points[i + 1]) + points[i]) inside = !inside;
  }
  return inside;
}

/* ---------- The camera: a point in m at the middle of a canvas, and pixels a metre ---------- */

class Camera {
  constructor() { this.x = 0; this.y = 0; this.scale = 4; }

  fit(box, width, height) {
    this.x = (box[0] + box[2]) / 2;
    this.y = (box[1] + box[3]) / 2;
    this.scale = Math.min(width / Math.max(box[2] - box[0], 1), height / Math.max(box[3] - box[1], 1));
  }

  zoom(factor, dx = 0, dy = 0) {
    const scale = Math.min(Math.max(this.scale * factor, 0.05), 80);
    this.x += dx / this.scale - dx / scale;
    this.y -= dy / this.scale - dy / scale;
    this.scale = scale;
  }

  toWorld(px, py, width, height) { return [this.x + (px - width / 2) / this.scale, this.y - (py - height / 2) / this.scale]; }

  toPixels(x, y, width, height) { return [width / 2 + (x - this.x) * this.scale, height / 2 - (y - this.y) * this.scale]; }
}

/* ---------- Drawing ---------- */

const SMALLEST_PX = 5, LABELLED_FROM_PX = 15, MOST_LABELS = 60;

/* Draws a pane at one time: { scene, tracks, ego, drive, camera, selected } on a canvas of a size in CSS pixels. */
function drawPane(context, pane, step, width, height, ratio, colours, showIds, showPlans) {
  const { scene, camera } = pane;
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.fillStyle = colours.field;
  context.fillRect(0, 0, width, height);
  const [left, top] = camera.toWorld(0, 0, width, height), [right, bottom] = camera.toWorld(width, height, width, height);
  const s = camera.scale * ratio;
  context.setTransform(s, 0, 0, -s, ratio * (width / 2 - camera.x * camera.scale), ratio * (height / 2 + camera.y * camera.scale));
  const inView = box => box[0] <= right && left <= box[2] && box[1] <= top && bottom <= box[3];
  const px = 1 / camera.scale;
  drawRoad(context, scene.tiles.filter(tile => inView(tile.box)), px, colours);
  drawGoals(context, scene.goals, px, colours);
  drawSignals(context, scene.signals, step, px, colours);
  drawCourse(context, pane, step, px, colours);
  if (showPlans) drawPlan(context, pane, step, px, colours);
  const seen = present(pane, step, left, bottom, right, top);
  drawUsers(context, scene.standing.filter(one => inView(one.box)), seen, pane, px, colours);
  drawEgo(context, pane, step, px, colours);
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  if (showIds && camera.scale * 4.5 >= LABELLED_FROM_PX) drawIds(context, seen, pane, width, height, colours);
  drawScaleBar(context, camera, height, colours);
  return seen.length;
}

function drawRoad(context, tiles, px, colours) {
  const layer = (name, paint) => { for (const tile of tiles) if (tile.layers[name]) paint(tile.layers[name]); };
  const filled = (name, colour) => {
    context.fillStyle = context.strokeStyle = colour;
    context.lineWidth = px;
    layer(name, path => { context.fill(path); context.stroke(path); });  // the stroke closes the seams between neighbours
  };
  const lined = (name, colour, widthPx, leastM = 0) => {
    context.strokeStyle = colour;
    context.lineWidth = Math.max(widthPx * px, leastM);
    layer(name, path => context.stroke(path));
  };
  context.lineJoin = "round";
  filled("pavements", colours.pavement);
  filled("surface", colours.road);
  if (px < 0.7) {
    context.setLineDash([3, 4.5]);
    lined("dividers", colours["lane-line"], 1, 0.13);
    context.setLineDash([]);
  }
  lined("edges", colours["road-edge"], 1, 0.1);
  if (px < 0.35) {
    context.fillStyle = colours.direction;
    layer("arrows", path => context.fill(path));
    context.fillStyle = colours["lane-line"];
    layer("crossings", path => context.fill(path));
  }
  lined("stop_lines", colours.ink, 1.5, 0.3);
}

function drawGoals(context, goals, px, colours) {
  const path = new Path2D();
  for (const goal of goals) trace(path, goal, true);
  context.globalAlpha = 0.16;
  context.fillStyle = colours.ego;
  context.fill(path);
  context.globalAlpha = 1;
  context.strokeStyle = colours.ego;
  context.lineWidth = 1.5 * px;
  context.setLineDash([6 * px, 4 * px]);
  context.stroke(path);
  context.setLineDash([]);
}

/* The shape shows the state as well: a square means stop, a disc go, a diamond the states between. */
const SIGNAL_MARKS = { red: ["square", "light-red"], redYellow: ["square", "light-yellow"], yellow: ["diamond", "light-yellow"], green: ["disc", "light-green"] };

function drawSignals(context, signals, step, px, colours) {
  const r = Math.max(5 * px, 0.5);
  context.strokeStyle = colours.ink;
  context.lineWidth = px;
  for (const signal of signals) {
    const [shape, colour] = SIGNAL_MARKS[signalState(signal, step)] ?? ["disc", "light-off"];
    const x = signal.x_cm / 100, y = signal.y_cm / 100;
    context.beginPath();
    if (shape === "disc") context.arc(x, y, r, 0, 2 * Math.PI);
    else if (shape === "square") context.rect(x - r, y - r, 2 * r, 2 * r);
    else { context.moveTo(x, y + 1.3 * r); context.lineTo(x + 1.3 * r, y); context.lineTo(x, y - 1.3 * r); context.lineTo(x - 1.3 * r, y); context.closePath(); }
    context.fillStyle = colours[colour];
    context.fill();
    context.stroke();
  }
}

function signalState(signal, step) {
  const cycle = signal.steps.reduce((sum, count) => sum + count, 0);
  if (!cycle) return "inactive";
  let at = ((Math.floor(step) - signal.offset) % cycle + cycle) % cycle;
  for (let i = 0; i < signal.steps.length; i++) if ((at -= signal.steps[i]) < 0) return signal.states[i];
  return "inactive";
}

/* The ego's path, solid behind it and dashed ahead; the path of the selection is thin. */
function drawCourse(context, pane, step, px, colours) {
  const selected = pane.selected > 0 && pane.tracks.find(track => track.id === pane.selected);
  if (selected) drawWay(context, selected, selected.first, selected.last, 1.5 * px, [2 * px, 3 * px], colours.ink);
  if (!pane.ego || !pane.drive) return;
  const now = Math.min(Math.max(step, pane.ego.first), pane.ego.last);
  drawWay(context, pane.ego, pane.ego.first, now, Math.max(2.5 * px, 0.25), [], colours.ego);
  drawWay(context, pane.ego, now, pane.ego.last, Math.max(1.5 * px, 0.15), [5 * px, 4 * px], colours.ego);
}

/* A planner's plan, candidates and predictions of a planning step, as paths. */
class PlanPaths {
  constructor(data) {
    this.step = data.step;
    this.plan = pathOf([data.plan]);
    this.candidates = pathOf(data.candidates);
    this.predictions = pathOf(data.predictions);
  }
}

function pathOf(lines) {
  const path = new Path2D();
  for (const line of lines) trace(path, pointsOf(line), false);
  return path;
}

/* The plan in force at a step, from the latest planning step. */
function planAt(plans, step) {
  let low = 0, high = plans.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (plans[middle].step <= step + 1e-9) low = middle + 1; else high = middle;
  }
  return plans[low - 1];
}

/* The outlines that a planner reported, as closed paths by planning step. */
function areasByStep(drive) {
  const byStep = drive.plan_steps.map(step => ({ step, path: new Path2D() }));
  const places = new Map(byStep.map((one, i) => [one.step, i]));
  for (const area of drive.areas) if (places.has(area.step)) trace(byStep[places.get(area.step)].path, pointsOf(area.outline), true);
  return byStep;
}

function drawAreas(context, pane, step, px, colours) {
  const now = pane.areas && planAt(pane.areas, step);
  if (!now || step > pane.ego.last) return;
  context.save();
  context.globalAlpha = 0.15;
  context.fillStyle = colours["series-2"];
  context.fill(now.path);
  context.restore();
  context.strokeStyle = colours["series-2"];
  context.lineWidth = 1.5 * px;
  context.setLineDash([]);
  context.stroke(now.path);
}

function drawPlan(context, pane, step, px, colours) {
  drawAreas(context, pane, step, px, colours);
  const now = pane.plans && planAt(pane.plans, step);
  if (!now || step > pane.ego.last) return;
  const stroke = (path, colour, width, dashes) => {
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.setLineDash(dashes);
    context.stroke(path);
  };
  stroke(now.candidates, colours.muted, px, []);
  stroke(now.predictions, colours["series-0"], 2 * px, [2 * px, 3 * px]);
  stroke(now.plan, colours.halo, 5 * px, []);
  stroke(now.plan, colours["series-5"], 2.5 * px, []);
  context.setLineDash([]);
}

function drawWay(context, track, from, to, width, dashes, colour) {
  if (to <= from) return;
  const state = {};
  context.beginPath();
  track.at(from, state);
  context.moveTo(state.x, state.y);
  for (let i = Math.ceil((from - track.first) / track.stride); i <= (to - track.first) / track.stride; i++) context.lineTo(track.x[i], track.y[i]);
  track.at(to, state);
  context.lineTo(state.x, state.y);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dashes);
  context.stroke();
  context.setLineDash([]);
}

/* The visible road users at a step, each { track, x, y, heading, speed }. */
function present(pane, step, left, bottom, right, top) {
  const seen = [], margin = 12;
  for (const track of pane.tracks) {
    const state = { track };
    if (track.at(step, state) && left - margin < state.x && state.x < right + margin && bottom - margin < state.y && state.y < top + margin) seen.push(state);
  }
  return seen;
}

/* The body of a road user: a circle for pedestrians, a diamond for two-wheelers, a rectangle for others, with a marked front. */
function body(context, kind, x, y, heading, length, width) {
  const c = Math.cos(heading), s = Math.sin(heading), a = length / 2, b = width / 2;
  const to = (u, v, first) => context[first ? "moveTo" : "lineTo"](x + u * c - v * s, y + u * s + v * c);
  if (kind === "pedestrian") {
    context.moveTo(x + Math.max(a, b), y);
    context.arc(x, y, Math.max(a, b), 0, 2 * Math.PI);
  } else if (kind === "bicycle" || kind === "motorcycle") {
    to(a, 0, true); to(0, b); to(-a, 0); to(0, -b); context.closePath();
  } else {
    to(a, b, true); to(-a, b); to(-a, -b); to(a, -b); context.closePath();
  }
}

function nose(context, x, y, heading, length, width) {
  const c = Math.cos(heading), s = Math.sin(heading), a = length / 2, back = 0.22 * length, b = width / 2;
  context.moveTo(x + a * c, y + a * s);
  context.lineTo(x + back * c - b * s, y + back * s + b * c);
  context.lineTo(x + back * c + b * s, y + back * s - b * c);
  context.closePath();
}

const least = (size, px, ratio) => Math.max(size, SMALLEST_PX * px * ratio);

function drawUsers(context, standing, seen, pane, px, colours) {
  context.lineWidth = Math.min(px, 0.2);
  context.strokeStyle = colours.outline;
  const standingPath = new Path2D();
  for (const one of standing) trace(standingPath, one.points, true);
  context.fillStyle = colours.other;
  context.fill(standingPath);
  context.stroke(standingPath);
  const groups = Map.groupBy ? Map.groupBy(seen, one => classOf(one.track.kind)) : grouped(seen);
  for (const [kind, users] of groups) {
    context.beginPath();
    for (const one of users) body(context, kind, one.x, one.y, one.heading, least(one.track.length, px, 1), least(one.track.width, px, 0.6));
    context.fillStyle = colours[kind];
    context.fill();
    context.stroke();
  }
  context.beginPath();
  for (const one of seen) if (one.track.kind !== "pedestrian") nose(context, one.x, one.y, one.heading, least(one.track.length, px, 1), least(one.track.width, px, 0.6) * 0.9);
  context.fillStyle = colours.outline;
  context.fill();
  const selected = seen.find(one => one.track.id === pane.selected);
  if (selected) ring(context, selected, px, colours.accent);
}

function grouped(seen) {
  const groups = new Map();
  for (const one of seen) {
    const kind = classOf(one.track.kind);
    groups.has(kind) ? groups.get(kind).push(one) : groups.set(kind, [one]);
  }
  return groups;
}

function ring(context, one, px, colour) {
  context.beginPath();
  context.arc(one.x, one.y, Math.max(one.track.length * 0.7, 9 * px), 0, 2 * Math.PI);
  context.strokeStyle = colour;
  context.lineWidth = 2.5 * px;
  context.stroke();
}

function drawEgo(context, pane, step, px, colours) {
  const { ego, drive } = pane;
  if (!ego) return;
  const at = drive ? Math.min(Math.max(step, ego.first), ego.last) : ego.first, state = { track: ego };
  ego.at(at, state);
  const length = least(ego.length, px, 1.4), width = least(ego.width, px, 0.8);
  context.beginPath();
  body(context, ego.kind === "moped" ? "motorcycle" : ego.kind, state.x, state.y, state.heading, length, width);
  context.globalAlpha = drive || step <= ego.first ? 1 : 0.45;
  context.fillStyle = colours.ego;
  context.fill();
  context.strokeStyle = colours.ink;
  context.lineWidth = Math.min(1.5 * px, 0.3);
  context.stroke();
  context.beginPath();
  nose(context, state.x, state.y, state.heading, length, width * 0.9);
  context.fillStyle = colours.outline;
  context.fill();
  context.globalAlpha = 1;
  if (pane.selected === 0) ring(context, state, px, colours.accent);
  if (drive && drive.collision_step !== null && step >= drive.collision_step) cross(context, state.x, state.y, px, colours);
}

function cross(context, x, y, px, colours) {
  const r = 9 * px;
  for (const [width, colour] of [[6, colours.ink], [3, colours.ground]]) {
    context.beginPath();
    context.moveTo(x - r, y - r); context.lineTo(x + r, y + r); context.moveTo(x - r, y + r); context.lineTo(x + r, y - r);
    context.lineWidth = width * px;
    context.strokeStyle = colour;
    context.stroke();
  }
}

/* Ids above their road users, nearest to the middle first; ids that would overlap are left out. */
function drawIds(context, seen, pane, width, height, colours) {
  const { camera } = pane, away = one => one.track.id === pane.selected ? -1 : Math.hypot(one.x - camera.x, one.y - camera.y);
  const nearest = seen.map(one => [away(one), one]).sort((a, b) => a[0] - b[0]).slice(0, MOST_LABELS);
  const taken = [];
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  context.textAlign = "center";
  context.textBaseline = "bottom";
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeStyle = colours.halo;
  context.fillStyle = colours.ink;
  for (const [, one] of nearest) {
    const text = String(one.track.id), half = 4 * text.length, [x, middle] = camera.toPixels(one.x, one.y, width, height);
    const y = middle - Math.max(one.track.width, Math.abs(Math.sin(one.heading)) * one.track.length) / 2 * camera.scale - 3;
    if (taken.some(([left, right, low]) => x - half < right && left < x + half && Math.abs(y - low) < 13)) continue;
    taken.push([x - half, x + half, y]);
    context.strokeText(text, x, y);
    context.fillText(text, x, y);
  }
}

function drawScaleBar(context, camera, height, colours) {
  const metres = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000].find(one => one * camera.scale >= 50) ?? 5000;
  const length = metres * camera.scale;
  context.strokeStyle = colours.ink;
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(12, height - 16); context.lineTo(12, height - 11); context.lineTo(12 + length, height - 11); context.lineTo(12 + length, height - 16);
  context.stroke();
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  context.textAlign = "left";
  context.textBaseline = "bottom";
  context.lineWidth = 3;
  context.strokeStyle = colours.halo;
  context.strokeText(`${metres} m`, 16, height - 16);
  context.fillStyle = colours.ink;
  context.fillText(`${metres} m`, 16, height - 16);
}
