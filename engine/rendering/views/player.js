/* The player: one scenario or run in motion, or two side by side, with the data of the shown time. */

/* ---------- Elements; text is only ever set as text ---------- */

function element(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(properties)) {
    if (name.startsWith("aria-") || name === "role" || name === "style" || name === "for") made.setAttribute(name, value);
    else made[name] = value;
  }
  made.append(...children.filter(child => child !== null && child !== undefined));
  return made;
}

const words = name => String(name).replaceAll("_", " ");
const egoWords = track => track.kind === "car" ? "ego" : `ego (${words(track.kind)})`;
const figure = (value, digits, unit) => value === null || value === undefined || Number.isNaN(value) ? "–" : `${(Math.round(value * 10 ** digits) / 10 ** digits + 0).toFixed(digits)} ${unit}`;

function outcomeMark(outcome) {
  const mark = element("span", { className: "outcome" }, words(outcome));
  mark.style.setProperty("--outcome", `var(--${outcome})`);
  return mark;
}

const KEYS = [
  ["Space", "play, pause"], ["← →", "a step; with Shift, a second"], ["Home End", "the start, the end"], ["N P", "next, previous moment"],
  ["+ −", "zoom; the wheel too"], ["W A S D", "move the view; dragging too"], ["F", "follow the ego, or what is selected"], ["0", "show all that matters"],
  ["V", "select the next vehicle; Shift: the previous"], ["E", "select the ego"], ["Esc", "select nothing"], ["I", "ids"], ["O", "plan, candidates, predictions, areas"], ["C", "next chart"],
  ["[ ]", "slower, faster"], ["T", "dark, light"],
];
const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4];
const SHOWN_EVERY_MS = 100;  /* interval of the figures during playback; faster would be unreadable */
const FOLLOWED_WIDTH_M = 110;

class Player {
  constructor(root, data, tell = () => {}) {
    this.tell = tell;
    this.data = data;
    this.scenes = new Map(data.scenes.map(scene => [scene.scenario_id, new Scene(scene)]));
    this.panes = data.panes.map((pane, i) => this.pane(pane, data.panes.length > 1 ? "AB"[i] : ""));
    this.stepS = this.panes[0].scene.stepS;
    const drives = this.panes.filter(pane => pane.drive);
    this.firstStep = Math.min(...(drives.length ? drives.map(pane => pane.ego.first) : this.panes.map(pane => pane.scene.firstStep)));
    this.lastStep = Math.max(...(drives.length === this.panes.length ? drives.map(pane => pane.ego.last) : this.panes.map(pane => pane.scene.lastStep)));
    this.step = Math.max(this.firstStep, this.panes[0].ego?.first ?? this.firstStep);
    this.playing = false;
    this.factor = 1;
    this.follow = false;
    this.ids = true;
    this.plans = true;
    this.chartKind = 0;
    this.stale = true;
    this.shownAt = 0;
    this.root = root;
    this.build();
    this.listen();
    this.recolour();
    this.resize();
    this.frameFirst();
    this.frame = requestAnimationFrame(now => this.tick(now));
  }

  pane(data, letter) {
    const scene = this.scenes.get(data.scenario_id), drive = data.drive;
    const tracks = scene.tracksOf(drive);
    const pane = { title: data.title, letter, scene, drive, tracks, ego: drive ? new Track(drive.ego) : scene.start, camera: new Camera(), selected: null };
    if (drive) pane.series = seriesOf(drive);
    if (drive?.plans.length) pane.plans = drive.plans.map(plan => new PlanPaths(plan));
    if (drive?.areas.length) pane.areas = areasByStep(drive);
    return pane;
  }

  /* ---------- The page ---------- */

  build() {
    const { data } = this;
    this.stages = element("div", { className: "stages" });
    this.stages.style.setProperty("--panes", this.panes.length);
    for (const pane of this.panes) this.stages.append(this.stage(pane));
    const body = element("div", { className: "body" }, this.stages, this.transport(), this.chart());
    const ids = element("div", { className: "ids" }, element("h1", {}, data.title));
    this.theme = element("button", { type: "button", title: "Dark or light (T)", onclick: () => this.toggleTheme() }, "Dark / light");
    const notes = data.notes.map(note => element("p", { className: "muted" }, note));
    this.root.replaceChildren(element("div", { className: "player" }, element("header", {}, ids, this.theme, ...notes), body, this.side()));
    this.box = this.root.firstChild;
    this.box.player = this;
  }

  stage(pane) {
    pane.canvas = element("canvas", { tabIndex: 0, role: "img", "aria-label": `${pane.scene.id} from above` });
    pane.tip = element("div", { className: "tip", hidden: true });
    const caption = element("figcaption", {}, pane.letter ? element("b", {}, `${pane.letter} `) : null, pane.drive ? `${pane.title} ` : pane.title);
    if (pane.drive) caption.append(outcomeMark(pane.drive.outcome), ` on ${pane.scene.id}`);
    return element("figure", { className: "stage" }, caption, pane.canvas, pane.tip);
  }

  transport() {
    const button = (label, title, onclick) => element("button", { type: "button", title, onclick, "aria-label": title }, label);
    this.playButton = button("Play", "Play or pause (Space)", () => this.toggle());
    this.playButton.className = "play";
    this.followButton = button("Follow", "Follow the ego or the selection (F)", () => this.setFollow(!this.follow));
    this.idsButton = button("Ids", "Show ids (I)", () => this.setIds(!this.ids));
    this.plansButton = button("Plans", "Show plan, candidates, predictions and areas (O)", () => this.setPlans(!this.plans));
    this.plansButton.hidden = !this.panes.some(pane => pane.plans || pane.areas);
    this.rate = element("select", { title: "Speed ([ and ])", "aria-label": "speed", onchange: () => { this.factor = Number(this.rate.value); } },
      ...SPEEDS.map(value => element("option", { value, selected: value === 1 }, `${value} ×`)));
    this.slider = element("input", { type: "range", min: this.firstStep, max: this.lastStep, step: 1, value: this.step, "aria-label": "time",
      oninput: () => this.seek(Number(this.slider.value)) });
    this.time = element("output", { className: "time" });
    const marks = this.moments().map(({ moment, pane }) => {
      const mark = button("", `${this.seconds(moment.step)}: ${moment.words}`, () => this.seek(moment.step, pane));
      mark.className = moment.decisive ? "mark decisive" : "mark";
      mark.tabIndex = -1;
      mark.style.left = `${100 * (moment.step - this.firstStep) / Math.max(this.lastStep - this.firstStep, 1)}%`;
      return mark;
    });
    return element("div", { className: "transport", role: "toolbar", "aria-label": "playback" },
      this.playButton, button("←", "A step back (←)", () => this.seek(Math.ceil(this.step) - 1)), button("→", "A step on (→)", () => this.seek(Math.floor(this.step) + 1)),
      element("div", { className: "scrub" }, this.slider, ...marks), this.time, this.rate, this.followButton, this.idsButton, this.plansButton,
      button("+", "Nearer (+)", () => this.zoom(1.3)), button("−", "Farther (−)", () => this.zoom(1 / 1.3)), button("All", "Show everything relevant (0)", () => this.fit()));
  }

  chart() {
    this.charts = chartsOf(this.panes);
    this.chartSelect = element("select", { "aria-label": "chart", title: "Chart (C)", onchange: () => { this.chartKind = this.chartSelect.selectedIndex; this.stale = true; } },
      ...this.charts.map(chart => element("option", {}, chart.name)));
    this.chartKeys = element("span");
    this.chartCanvas = element("canvas", { role: "img", "aria-label": "figures over time" });
    this.chartTip = element("div", { className: "tip", hidden: true });
    return element("div", { className: "chart" }, element("div", { className: "head" }, this.chartSelect, this.chartKeys), this.chartCanvas, this.chartTip);
  }

  side() {
    this.now = element("tbody");
    const heads = this.panes.map(pane => element("th", { className: "number", scope: "col" }, pane.letter || "now"));
    const nowTable = element("table", {}, element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "at the moment"), ...heads)), this.now);
    this.picked = element("div", {}, element("p", { className: "muted" }, "Click a vehicle, or press V."));
    const parts = [element("section", { className: "now" }, nowTable), element("section", { className: "picked", "aria-live": "polite" }, element("h2", {}, "Selected"), this.picked)];
    const moments = this.moments();
    if (moments.length) {
      const items = moments.map(({ moment, pane }) => element("li", {}, element("button", { type: "button", className: moment.decisive ? "decisive" : "", onclick: () => this.seek(moment.step, pane) },
        `${this.seconds(moment.step)}  ${pane.letter ? `${pane.letter}: ` : ""}${moment.words}`)));
      parts.push(element("section", { className: "moments" }, element("h2", {}, "Moments"), element("ol", {}, ...items)));
    }
    for (const pane of this.panes.filter(one => one.drive)) parts.push(runSection(pane));
    parts.push(this.legend());
    parts.push(element("section", {}, element("details", {}, element("summary", {}, "Keys"), element("table", {}, element("tbody", {},
      ...KEYS.map(([key, what]) => element("tr", {}, element("td", {}, ...key.split(" ").map(one => element("kbd", {}, one)).flatMap(one => [one, " "])), element("td", {}, what))))))));
    return element("div", { className: "side" }, ...parts);
  }

  legend() {
    const counts = new Map();
    for (const { kind } of [...this.panes[0].tracks, ...this.panes[0].scene.standing]) counts.set(kind, (counts.get(kind) ?? 0) + 1);
    const row = (colour, text) => {
      const swatch = element("span", { className: "swatch" });
      swatch.style.background = `var(--${colour})`;
      return element("li", {}, swatch, text);
    };
    const rows = [...counts].sort().map(([kind, count]) => row(classOf(kind), `${words(kind)}: ${count}`));
    if (this.panes.some(pane => pane.ego)) rows.unshift(row("ego", "ego; dashed field: its goal"));
    if (this.panes.some(pane => pane.plans)) rows.push(row("series-5", "plan; thin: other candidates"), row("series-0", "dotted: where the planner expected others"));
    const areas = [...new Set(this.panes.flatMap(pane => (pane.drive?.areas ?? []).map(area => area.name)))];
    if (areas.length) rows.push(row("series-2", `areas that the planner reported: ${areas.map(words).join(", ")}`));
    return element("section", {}, element("h2", {}, "Road users"), element("ul", {}, ...rows));
  }

  moments() {
    const all = this.panes.flatMap(pane => (pane.drive?.moments ?? []).map(moment => ({ moment, pane })));
    return all.sort((a, b) => a.moment.step - b.moment.step);
  }

  seconds(step) { return `${(step * this.stepS).toFixed(1)} s`; }

  /* ---------- Input: keys, pointer, size, colours ---------- */

  listen() {
    this.ended = new AbortController();
    const { signal } = this.ended;
    document.addEventListener("keydown", event => this.key(event), { signal });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.recolour(), { signal });
    addEventListener("themechange", () => this.recolour(), { signal });
    this.observer = new ResizeObserver(() => this.resize());
    for (const pane of this.panes) { this.observer.observe(pane.canvas); this.pointer(pane, signal); }
    this.observer.observe(this.chartCanvas);
    this.chartPointer(signal);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented) return;
    const kind = event.target.tagName;
    if (kind === "SELECT" || (kind === "INPUT" && event.target.type !== "range")) return;
    if (event.key === " " && (kind === "BUTTON" || kind === "SUMMARY")) return;
    const second = Math.max(Math.round(1 / this.stepS), 1), move = 40;
    const actions = {
      " ": () => this.toggle(), "ArrowLeft": () => this.seek(Math.ceil(this.step) - (event.shiftKey ? second : 1)), "ArrowRight": () => this.seek(Math.floor(this.step) + (event.shiftKey ? second : 1)),
      "Home": () => this.seek(this.firstStep), "End": () => this.seek(this.lastStep), "n": () => this.nextMoment(1), "p": () => this.nextMoment(-1),
      "+": () => this.zoom(1.3), "=": () => this.zoom(1.3), "-": () => this.zoom(1 / 1.3), "0": () => this.fit(),
      "w": () => this.pan(0, move), "s": () => this.pan(0, -move), "a": () => this.pan(move, 0), "d": () => this.pan(-move, 0),
      "f": () => this.setFollow(!this.follow), "v": () => this.selectNext(event.shiftKey ? -1 : 1), "e": () => this.select(this.panes[0], this.panes[0].ego ? 0 : null),
      "i": () => this.setIds(!this.ids), "o": () => this.setPlans(!this.plans), "c": () => this.nextChart(), "[": () => this.changeRate(-1), "]": () => this.changeRate(1), "t": () => this.toggleTheme(),
      "Escape": () => this.panes.some(pane => pane.selected !== null) && this.select(this.panes[0], null),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (action && action() !== false) event.preventDefault();
  }

  pointer(pane, signal) {
    const { canvas } = pane, held = new Map();
    let moved = 0;
    const place = event => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
    const spread = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
    canvas.addEventListener("pointerdown", event => { canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, place(event)); moved = 0; }, { signal });
    canvas.addEventListener("pointermove", event => {
      const now = place(event), before = held.get(event.pointerId);
      if (!before) { this.hover(pane, ...now); return; }
      const apart = held.size === 2 ? spread() : 0;
      held.set(event.pointerId, now);
      moved += Math.abs(now[0] - before[0]) + Math.abs(now[1] - before[1]);
      if (held.size === 2) this.zoom(spread() / Math.max(apart, 1));
      else if (moved > 4) this.pan(now[0] - before[0], now[1] - before[1]);
    }, { signal });
    const release = event => {
      if (held.delete(event.pointerId) && event.type === "pointerup" && moved <= 4) this.select(pane, this.userAt(pane, ...place(event))?.track.id ?? null);
    };
    canvas.addEventListener("pointerup", release, { signal });
    canvas.addEventListener("pointercancel", release, { signal });
    canvas.addEventListener("pointerleave", () => { pane.tip.hidden = true; }, { signal });
    canvas.addEventListener("wheel", event => {
      event.preventDefault();
      const [x, y] = place(event);
      this.zoom(Math.exp(-event.deltaY / 500), x - canvas.clientWidth / 2, y - canvas.clientHeight / 2);
    }, { passive: false, signal });
  }

  /* The object under a point of a pane: the ego, a road user, or nothing. */
  userAt(pane, px, py) {
    const [x, y] = pane.camera.toWorld(px, py, pane.canvas.clientWidth, pane.canvas.clientHeight), margin = Math.max(0.4, 6 / pane.camera.scale);
    let best = null, nearest = Infinity;
    for (const track of pane.ego ? [pane.ego, ...pane.tracks] : pane.tracks) {
      const state = { track };
      if (!track.at(this.moment(pane, track), state)) continue;
      const dx = x - state.x, dy = y - state.y, c = Math.cos(state.heading), s = Math.sin(state.heading);
      const along = Math.abs(dx * c + dy * s), across = Math.abs(dy * c - dx * s), away = Math.hypot(dx, dy);
      if (along <= track.length / 2 + margin && across <= track.width / 2 + margin && away < nearest) { best = state; nearest = away; }
    }
    return best;
  }

  /* The step at which a pane shows a track: a run stays at its end, the ego waits at its start. */
  moment(pane, track) {
    const step = pane.drive ? Math.min(this.step, pane.ego.last) : this.step;
    return track === pane.ego ? Math.min(Math.max(step, track.first), track.last) : step;
  }

  hover(pane, px, py) {
    const under = this.userAt(pane, px, py);
    pane.canvas.classList.toggle("over", under !== null);
    let text;
    if (under) text = `${under.track === pane.ego ? egoWords(under.track) : `${words(under.track.kind)} ${under.track.id}`}  ${under.speed.toFixed(1)} m/s`;
    else {
      const [x, y] = pane.camera.toWorld(px, py, pane.canvas.clientWidth, pane.canvas.clientHeight), lanelets = pane.scene.laneletsAt(x, y);
      if (lanelets.length) text = `lanelet ${lanelets.slice(0, 4).join(", ")}`;
    }
    pane.tip.hidden = !text;
    if (!text) return;
    pane.tip.textContent = text;
    placeTip(pane.tip, px, py + pane.canvas.offsetTop, pane.canvas.clientWidth);
  }

  chartPointer(signal) {
    const canvas = this.chartCanvas;
    const stepAt = event => this.firstStep + (event.clientX - canvas.getBoundingClientRect().left - CHART_LEFT) / Math.max(canvas.clientWidth - CHART_LEFT - CHART_RIGHT, 1) * (this.lastStep - this.firstStep);
    let down = false;
    canvas.addEventListener("pointerdown", event => { down = true; canvas.setPointerCapture(event.pointerId); this.seek(Math.round(stepAt(event))); }, { signal });
    canvas.addEventListener("pointerup", () => { down = false; }, { signal });
    canvas.addEventListener("pointermove", event => {
      const step = Math.min(Math.max(Math.round(stepAt(event)), this.firstStep), this.lastStep);
      if (down) this.seek(step);
      this.chartAt = step;
      this.stale = true;
      const lines = this.charts[this.chartKind].told(step, this.panes);
      this.chartTip.textContent = [`${this.seconds(step)}`, ...lines].join("\n");
      this.chartTip.hidden = false;
      placeTip(this.chartTip, event.clientX - canvas.getBoundingClientRect().left, canvas.offsetTop + 4, canvas.clientWidth);
    }, { signal });
    canvas.addEventListener("pointerleave", () => { this.chartAt = null; this.chartTip.hidden = true; this.stale = true; }, { signal });
  }

  resize() {
    this.ratio = Math.min(devicePixelRatio || 1, 2);
    for (const canvas of [...this.panes.map(pane => pane.canvas), this.chartCanvas]) {
      canvas.width = Math.max(Math.round(canvas.clientWidth * this.ratio), 1);
      canvas.height = Math.max(Math.round(canvas.clientHeight * this.ratio), 1);
    }
    if (!this.panes.every(pane => pane.camera.scale > 0)) this.frameFirst();  // it had no size while its host kept it hidden
    else if (this.whole) this.fit();
    this.stale = true;
  }

  recolour() { this.colours = palette(); this.stale = true; }

  toggleTheme() { setTheme(isDark() ? "light" : "dark"); }

  /* ---------- Actions ---------- */

  toggle() {
    if (!this.playing && this.step >= this.lastStep) this.step = this.firstStep;
    this.playing = !this.playing;
    this.playedAt = null;
    this.stale = true;
  }

  seek(step, pane = null) {
    this.playing = false;
    this.step = Math.min(Math.max(step, this.firstStep), this.lastStep);
    this.stale = true;
    if (pane) this.tell(`${this.name(pane)} at ${this.seconds(this.step)}`);
  }

  nextMoment(direction) {
    const steps = [...new Set(this.moments().map(({ moment }) => moment.step))];
    const next = direction > 0 ? steps.find(step => step > this.step) : steps.findLast(step => step < this.step);
    if (next !== undefined) this.seek(next);
  }

  changeRate(direction) {
    const place = Math.min(Math.max(SPEEDS.indexOf(this.factor) + direction, 0), SPEEDS.length - 1);
    this.factor = SPEEDS[place];
    this.rate.selectedIndex = place;
  }

  nextChart() { this.chartKind = this.chartSelect.selectedIndex = (this.chartKind + 1) % this.charts.length; this.stale = true; }

  setIds(on) { this.ids = on; this.stale = true; }

  setPlans(on) { this.plans = on; this.stale = true; }

  setFollow(on) { this.follow = on; this.whole = false; this.stale = true; }

  zoom(factor, dx = 0, dy = 0) { this.whole = false; for (const pane of this.panes) pane.camera.zoom(factor, this.follow ? 0 : dx, this.follow ? 0 : dy); this.stale = true; }

  pan(dx, dy) {
    this.follow = this.whole = false;
    for (const { camera } of this.panes) { camera.x -= dx / camera.scale; camera.y += dy / camera.scale; }
    this.stale = true;
  }

  /* The initial view: a whole scenario, or a run near its ego. */
  frameFirst() {
    this.fit();
    if (this.panes.some(pane => pane.drive)) this.zoomToFollow();
  }

  /* All panes show the relevant part at one scale until the view moves; scenes on one map show the same place. */
  fit() {
    this.follow = false;
    this.whole = true;
    const inWorld = ({ scene }) => { const [x, y] = scene.origin; return [scene.shown[0] + x, scene.shown[1] + y, scene.shown[2] + x, scene.shown[3] + y]; };
    const boxes = this.panes.map(inWorld), all = [Math.min(...boxes.map(b => b[0])), Math.min(...boxes.map(b => b[1])), Math.max(...boxes.map(b => b[2])), Math.max(...boxes.map(b => b[3]))];
    const together = all[2] - all[0] < 600 && all[3] - all[1] < 600;
    this.panes.forEach((pane, i) => {
      const box = together ? all : boxes[i], [x, y] = pane.scene.origin;
      pane.camera.fit([box[0] - x, box[1] - y, box[2] - x, box[3] - y], pane.canvas.clientWidth, pane.canvas.clientHeight);
    });
    const scale = Math.min(...this.panes.map(pane => pane.camera.scale));
    for (const pane of this.panes) pane.camera.scale = scale;
    this.stale = true;
  }

  zoomToFollow() {
    this.setFollow(true);
    for (const pane of this.panes) pane.camera.scale = Math.max(pane.camera.scale, pane.canvas.clientWidth / FOLLOWED_WIDTH_M);
    const scale = Math.min(...this.panes.map(pane => pane.camera.scale));
    for (const pane of this.panes) pane.camera.scale = scale;
  }

  select(pane, id) {
    for (const one of this.panes) one.selected = id !== null && (one === pane || id === 0 || one.tracks.some(track => track.id === id)) ? id : null;
    this.stale = true;
    if (id !== null) this.tell(`${this.name(pane)} at ${this.seconds(this.step)}, selected: ${id === 0 ? "the ego" : `obstacle ${id}`}`);
  }

  selectNext(direction) {
    const pane = this.panes[0], state = {};
    const there = pane.tracks.filter(track => track.at(this.moment(pane, track), state));
    if (!there.length) return;
    const at = there.findIndex(track => track.id === pane.selected);
    this.select(pane, there[(at + direction + (at < 0 && direction < 0 ? 1 : 0) + there.length) % there.length].id);
  }

  name(pane) { return pane.drive ? `run ${pane.drive.run_id} on ${pane.scene.id}` : `scenario ${pane.scene.id}`; }

  destroy() {
    cancelAnimationFrame(this.frame);
    this.observer.disconnect();
    this.ended.abort();
  }

  /* ---------- Frames ---------- */

  tick(now) {
    if (this.playing) {
      if (this.playedAt !== null) this.step += Math.min(now - this.playedAt, 250) / 1000 / this.stepS * this.factor;
      this.playedAt = now;
      if (this.step >= this.lastStep) { this.step = this.lastStep; this.playing = false; }
      this.stale = true;
    }
    if (this.stale) {
      this.stale = false;
      this.draw();
      if (!this.playing || now - this.shownAt >= SHOWN_EVERY_MS) { this.shownAt = now; this.show(); }
    }
    this.frame = requestAnimationFrame(next => this.tick(next));
  }

  draw() {
    for (const pane of this.panes) {
      if (this.follow) this.centre(pane);
      const step = pane.drive ? Math.min(this.step, pane.ego.last) : this.step;
      drawPane(pane.canvas.getContext("2d", { alpha: false }), pane, step, pane.canvas.clientWidth, pane.canvas.clientHeight, this.ratio, this.colours, this.ids, this.plans);
    }
    this.drawChart();
  }

  centre(pane) {
    const track = pane.selected > 0 ? pane.tracks.find(one => one.id === pane.selected) : pane.ego, state = {};
    if (!track || !track.at(this.moment(pane, track), state)) return;
    pane.camera.x = state.x;
    pane.camera.y = state.y;
  }

  drawChart() {
    const canvas = this.chartCanvas, context = canvas.getContext("2d");
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    drawChart(context, this.charts[this.chartKind], this, canvas.clientWidth, canvas.clientHeight);
  }

  /* The figures of the shown time, next to the canvas. */
  show() {
    const step = Math.round(this.step);
    this.slider.value = step;
    this.time.textContent = `${this.seconds(this.step)} of ${this.seconds(this.lastStep)}`;
    this.playButton.textContent = this.playing ? "Pause" : "Play";
    this.followButton.setAttribute("aria-pressed", this.follow);
    this.idsButton.setAttribute("aria-pressed", this.ids);
    this.plansButton.setAttribute("aria-pressed", this.plans);
    const chart = this.charts[this.chartKind];
    if (this.keysOf !== chart) { this.keysOf = chart; this.chartKeys.replaceChildren(...chart.keys(this.panes)); }
    this.now.replaceChildren(...this.nowRows(step));
    this.showPicked();
  }

  nowRows(step) {
    const row = (name, values, colour) => {
      const head = element("th", { scope: "row" });
      if (colour) { const swatch = element("span", { className: "swatch" }); swatch.style.background = `var(--${colour})`; head.append(swatch); }
      head.append(name);
      return element("tr", {}, head, ...values.map(value => element("td", { className: "number" }, value)));
    };
    const rows = [], each = told => this.panes.map(pane => pane.drive ? told(pane.series, pane) : "–");
    const state = {};
    rows.push(row("speed", this.panes.map(pane => pane.ego && pane.ego.at(this.moment(pane, pane.ego), state) ? figure(state.speed, 1, "m/s") : "–")));
    if (this.panes.some(pane => pane.drive)) {
      rows.push(row("acceleration", each(series => figure(series.acceleration(step), 2, "m/s²"))));
      rows.push(row("gap", each(series => figure(series.gap(step), 2, "m"))));
      rows.push(row("nearest", each(series => String(series.nearest(step) ?? "–"))));
      rows.push(row("time to collision", each(series => figure(series.collision(step), 2, "s"))));
      rows.push(row("cost", each(series => figure(series.total(step), 3, ""))));
      const terms = termsOf(this.panes);
      terms.forEach((term, i) => rows.push(row(words(term), each(series => figure(series.term(term, step), 3, "")), this.panes.length === 1 && i < 6 ? `series-${i}` : null)));
      for (const name of keysOf(this.panes, "series")) rows.push(row(name, each(series => figure(series.state(name, step), 2, ""))));
      for (const name of keysOf(this.panes, "planned")) rows.push(row(words(name), each(series => figure(series.planned(name, step), 3, ""))));
      for (const name of keysOf(this.panes, "told")) rows.push(row(words(name), each(series => series.told(name, step) || "–")));
      const rejected = [...new Set(this.panes.flatMap(pane => Object.keys(pane.drive?.rejected ?? {})))];
      for (const name of rejected) rows.push(row(`rejected: ${words(name)}`, each(series => String(series.rejected(name, step) ?? "–"))));
    }
    rows.push(row("road users", this.panes.map(pane => String(pane.tracks.filter(track => track.first <= step && step <= track.last).length + pane.scene.standing.length))));
    return rows;
  }

  showPicked() {
    const pane = this.panes.find(one => one.selected !== null);
    if (!pane) {
      if (this.pickedKey !== null) { this.pickedKey = null; this.picked.replaceChildren(element("p", { className: "muted" }, "Click a vehicle, or press V.")); }
      return;
    }
    const rows = [];
    for (const one of this.panes.filter(other => other.selected !== null)) {
      const track = one.selected === 0 ? one.ego : one.tracks.find(other => other.id === one.selected), state = {}, egoState = {};
      if (!track) continue;
      if (one.letter) rows.push([`in ${one.letter}`, ""]);
      rows.push([track === one.ego ? egoWords(track) : words(track.kind), track === one.ego ? "" : String(track.id)]);
      rows.push(["length × width", `${track.length.toFixed(2)} × ${track.width.toFixed(2)} m`]);
      if (track.at(this.moment(one, track), state)) {
        rows.push(["speed", `${state.speed.toFixed(1)} m/s (${(3.6 * state.speed).toFixed(0)} km/h)`]);
        rows.push(["heading", `${(((state.heading * 180 / Math.PI) % 360 + 360) % 360).toFixed(0)}°`]);
        rows.push(["place", `${(state.x + one.scene.origin[0]).toFixed(1)}, ${(state.y + one.scene.origin[1]).toFixed(1)} m`]);
        rows.push(["lanelet", one.scene.groundAt(state.x, state.y)]);
        if (track !== one.ego && one.ego && one.ego.at(this.moment(one, one.ego), egoState)) rows.push(["from the ego, centre to centre", `${Math.hypot(state.x - egoState.x, state.y - egoState.y).toFixed(1)} m`]);
      } else rows.push(["now", "not there"]);
      rows.push(["there", `${this.seconds(track.first)} to ${this.seconds(track.last)}`]);
      if (track !== one.ego) rows.push(["moves", track.driven ? "by reactive traffic" : "by its recording"]);
      if (one.drive && one.drive.collision_id === track.id) rows.push(["collision", `with the ego at ${this.seconds(one.drive.collision_step)}`]);
    }
    const standing = rows.length ? null : element("p", {}, "–");
    this.pickedKey = pane.selected;
    this.picked.replaceChildren(standing ?? element("table", {}, element("tbody", {}, ...rows.map(([name, value]) => element("tr", {}, element("th", { scope: "row" }, name), element("td", { className: "number" }, value))))));
  }
}

/* The views that a page can show, by the kind of its data. */
const VIEWS = { player: Player };

function placeTip(tip, x, y, width) {
  tip.style.left = x > width / 2 ? "auto" : `${x + 14}px`;
  tip.style.right = x > width / 2 ? `${width - x + 14}px` : "auto";
  tip.style.top = `${Math.max(y - 10, 0)}px`;
}

function runSection(pane) {
  const { drive } = pane;
  const rows = drive.figures.map(([name, value]) => element("tr", {}, element("th", { scope: "row" }, name), element("td", { className: "number" }, value)));
  return element("section", {}, element("h2", {}, `${pane.letter} ${drive.name}`.trim()), element("p", {}, drive.ending),
    element("p", { className: "muted" }, `${drive.run_id}; ${words(drive.prediction)} prediction, ${drive.traffic} traffic`),
    element("details", {}, element("summary", {}, "Metrics"), element("table", {}, element("tbody", {}, ...rows))));
}

/* ---------- A run over time ---------- */

function seriesOf(drive) {
  const ego = new Track(drive.ego), acceleration = summed(drive.acceleration_cmps2, 0.01), plans = drive.plan_steps;
  const at = (values, step) => { const i = step - ego.first; return values.length && 0 <= i && i < values.length ? values[i] : null; };
  const hundredths = (values, step) => { const value = at(values, step); return value === null ? null : value / 100; };
  const planned = step => { let found = -1; for (let i = 0; i < plans.length && plans[i] <= step; i++) found = i; return found; };
  const terms = Object.keys(drive.costs);
  return {
    ego,
    speed: step => at(ego.speed, step),
    acceleration: step => at(acceleration, step),
    gap: step => hundredths(drive.gap_cm, step),
    nearest: step => at(drive.nearest, step),
    collision: step => hundredths(drive.collision_cs, step),
    term: (name, step) => drive.costs[name]?.[planned(step)] ?? null,
    rejected: (name, step) => drive.rejected[name]?.[planned(step)] ?? null,
    state: (name, step) => drive.series[name] ? at(drive.series[name], step) ?? null : null,
    planned: (name, step) => drive.planned[name]?.[planned(step)] ?? null,
    told: (name, step) => drive.told[name]?.[planned(step)] ?? "",
    total: step => { const i = planned(step); return i < 0 || !terms.length ? null : terms.reduce((sum, name) => sum + drive.costs[name][i], 0); },
  };
}

/* The names in one of the records of all panes' runs. */
function keysOf(panes, record) { return [...new Set(panes.flatMap(({ drive }) => Object.keys(drive?.[record] ?? {})))]; }

/* The cost terms of all panes, largest over the runs first. */
function termsOf(panes) {
  const weights = new Map();
  for (const { drive } of panes) for (const [name, values] of Object.entries(drive?.costs ?? {})) weights.set(name, (weights.get(name) ?? 0) + values.reduce((sum, value) => sum + Math.abs(value), 0));
  return [...weights].sort((a, b) => b[1] - a[1] || (a[0] < b[0] ? -1 : 1)).map(([name]) => name);
}

const DASHES = [[], [7, 4]], CHART_LEFT = 52, CHART_RIGHT = 8, MOST_BANDS = 6;

function chartsOf(panes) {
  const runs = panes.filter(pane => pane.drive);
  const line = (name, unit, digits, value, ceiling = Infinity) => ({
    name: unit ? `${name} (${unit})` : name,
    curves: all => all.map((pane, i) => ({ pane, colour: `series-${i}`, dashes: DASHES[i], value: step => { const y = value(pane, step); return y !== null && y <= ceiling ? y : null; } })),
    told: (step, all) => all.map(pane => `${pane.letter || name} ${figure(value(pane, step), digits, unit)}`),
    keys: all => all.length < 2 ? [] : all.map((pane, i) => chartKey(`${pane.letter} ${pane.title}`, `series-${i}`, i > 0)),
  });
  const state = {};
  const speed = (pane, step) => {
    const track = pane.selected > 0 ? pane.tracks.find(one => one.id === pane.selected) : pane.drive ? pane.ego : null;
    return track && track.at(step, state) ? state.speed : null;
  };
  const charts = [line("speed of the ego or what is selected", "m/s", 1, speed)];
  if (!runs.length) return charts;
  charts.push(line("acceleration", "m/s²", 2, (pane, step) => pane.series?.acceleration(step) ?? null));
  charts.push(line("gap to the nearest", "m", 2, (pane, step) => pane.series?.gap(step) ?? null));
  charts.push(line("time to collision up to 10 s", "s", 2, (pane, step) => pane.series?.collision(step) ?? null, 10));
  if (termsOf(panes).length) charts.push(panes.length === 1 ? bands(panes) : line("cost of the plan", "", 3, (pane, step) => pane.series?.total(step) ?? null));
  for (const name of keysOf(panes, "series")) charts.push(line(name, "", 2, (pane, step) => pane.series?.state(name, step) ?? null));
  for (const name of keysOf(panes, "planned")) charts.push(line(words(name), "", 3, (pane, step) => pane.drive && step <= pane.ego.last ? pane.series.planned(name, step) : null));
  return charts;
}

/* The cost of a plan as stacked terms, with the smallest ones combined. */
function bands(panes) {
  const terms = termsOf(panes), shown = terms.slice(0, MOST_BANDS), rest = terms.slice(MOST_BANDS), { series } = panes[0];
  const named = [...shown.map((term, i) => [words(term), `series-${i}`, step => series.term(term, step)]),
    ...(rest.length ? [["all others", "other", step => rest.reduce((sum, term) => sum + (series.term(term, step) ?? 0), 0)]] : [])];
  return {
    name: "cost terms",
    bands: named.map(([, colour, value]) => ({ colour, value })),
    curves: () => [],
    told: step => [`cost ${figure(series.total(step), 3, "")}`, ...terms.filter(term => series.term(term, step)).map(term => `${words(term)} ${figure(series.term(term, step), 3, "")}`)],
    keys: () => named.map(([name, colour]) => chartKey(name, colour, false)),
  };
}

function chartKey(name, colour, dashed) {
  const stroke = element("span", { className: dashed ? "keyline dashed" : "keyline" });
  stroke.style.color = `var(--${colour})`;
  return element("span", { style: "margin-right: 12px; white-space: nowrap" }, stroke, name);
}

function drawChart(context, chart, player, width, height) {
  const { colours, firstStep, lastStep, panes } = player, top = 8, bottom = height - 20;
  const x = step => CHART_LEFT + (step - firstStep) / Math.max(lastStep - firstStep, 1) * (width - CHART_LEFT - CHART_RIGHT);
  context.clearRect(0, 0, width, height);
  const stride = Math.max(Math.floor((lastStep - firstStep) / width), 1), steps = [];
  for (let step = firstStep; step <= lastStep; step += stride) steps.push(step);
  const curves = chart.curves(panes).map(curve => ({ ...curve, values: steps.map(curve.value) }));
  const stacked = stack(chart, steps);
  const all = [...curves.flatMap(curve => curve.values), ...stacked.flatMap(band => [...band.low, ...band.high])].filter(value => value !== null);
  context.font = "12px system-ui, 'DejaVu Sans', sans-serif";
  if (!all.length) {
    context.fillStyle = colours.muted;
    context.textAlign = "left";
    context.textBaseline = "middle";
    context.fillText(panes.some(pane => pane.drive) ? "No such figures are available." : "Select a vehicle to see its speed.", CHART_LEFT, height / 2);
    return;
  }
  const ticks = ticksOf(Math.min(0, ...all), Math.max(...all)), low = ticks[0], high = ticks[ticks.length - 1];
  const y = value => bottom - (value - low) / (high - low) * (bottom - top);
  drawAxes(context, ticks, x, y, player, width, bottom);
  for (const band of stacked) {
    context.beginPath();
    steps.forEach((step, i) => { if (i) context.lineTo(x(step), y(band.high[i - 1])); context[i ? "lineTo" : "moveTo"](x(step), y(band.high[i])); });
    for (let i = steps.length - 1; i >= 0; i--) { context.lineTo(x(steps[i]), y(band.low[i])); if (i) context.lineTo(x(steps[i]), y(band.low[i - 1])); }
    context.closePath();
    context.fillStyle = colours[band.colour];
    context.fill();
    context.strokeStyle = colours.ground;
    context.lineWidth = 0.75;
    context.stroke();
  }
  for (const curve of curves) {
    context.beginPath();
    let drawn = false;
    curve.values.forEach((value, i) => {
      if (value === null) drawn = false;
      else { context[drawn ? "lineTo" : "moveTo"](x(steps[i]), y(value)); drawn = true; }
    });
    context.strokeStyle = colours[curve.colour];
    context.lineWidth = 2;
    context.setLineDash(curve.dashes);
    context.stroke();
    context.setLineDash([]);
  }
  cursor(context, x(player.step), top, bottom, colours.ink, 2);
  if (player.chartAt !== null && player.chartAt !== undefined) cursor(context, x(player.chartAt), top, bottom, colours.muted, 1);
}

/* The bands of a stacked chart, { colour, low, high }, one value per step; a negative term goes down from its start. */
function stack(chart, steps) {
  const base = steps.map(() => 0);
  return (chart.bands ?? []).map(({ colour, value }) => {
    const low = [...base], high = steps.map((step, i) => low[i] + (value(step) ?? 0));
    high.forEach((sum, i) => { base[i] = sum; });
    return { colour, low, high };
  });
}

function ticksOf(low, high) {
  const span = Math.max(high - low, 1e-6), raw = span / 3, power = 10 ** Math.floor(Math.log10(raw));
  const size = [1, 2, 2.5, 5, 10].map(one => one * power).find(one => one >= raw), ticks = [];
  for (let i = Math.floor(low / size + 1e-9); i <= Math.ceil(high / size - 1e-9); i++) ticks.push(i * size);
  return ticks.length > 1 ? ticks : [ticks[0], ticks[0] + size];
}

function drawAxes(context, ticks, x, y, player, width, bottom) {
  const { colours } = player, digits = Math.max(0, Math.min(4, -Math.floor(Math.log10(ticks[1] - ticks[0]) + 1e-9) + (String(ticks[1] - ticks[0]).includes("25") ? 1 : 0)));
  context.strokeStyle = colours.line;
  context.fillStyle = colours.muted;
  context.lineWidth = 1;
  context.textAlign = "right";
  context.textBaseline = "middle";
  for (const tick of ticks) {
    context.beginPath();
    context.moveTo(CHART_LEFT, y(tick));
    context.lineTo(width - CHART_RIGHT, y(tick));
    context.stroke();
    context.fillText(tick.toFixed(digits), CHART_LEFT - 6, y(tick));
  }
  context.textBaseline = "top";
  context.textAlign = "center";
  const seconds = (player.lastStep - player.firstStep) * player.stepS, every = [0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500].find(one => seconds / one <= width / 60) ?? 1000;
  for (let t = Math.ceil(player.firstStep * player.stepS / every) * every; t <= player.lastStep * player.stepS + 1e-9; t += every) context.fillText(`${+t.toFixed(1)} s`, Math.min(x(t / player.stepS), width - 18), bottom + 5);
}

function cursor(context, x, top, bottom, colour, width) {
  context.beginPath();
  context.moveTo(x, top);
  context.lineTo(x, bottom);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.stroke();
}
