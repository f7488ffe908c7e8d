/* The board: an overview of the runs of batches, as a grid of scenarios and configurations or as a table. A run opens in the player. */

const GOOD = "goal_reached";
const FLIPS = { to_success: ["▲", "reaches the goal here, and not in the first column"], to_failure: ["▼", "fails here, and not in the first column"] };
const BOARD_KEYS = [
  ["← → ↑ ↓", "go from run to run"], ["Enter", "open the run in the player"], ["Shift+Enter", "open it next to that of the first column"],
  ["Esc", "back to the board"], ["/", "search"], ["X", "flips only"], ["Z", "failures only"], ["G", "grid, table"], ["R", "show everything again"], ["T", "dark, light"],
];

class Board {
  constructor(root, data, tell = () => {}, host = null) {
    Object.assign(this, { root, data, tell, host });
    this.filter = { text: "", outcome: "", flips: false, failures: false };
    this.asTable = false;
    this.sorted = { by: "", up: true };
    this.current = data.runs[0]?.run_id ?? null;
    this.byId = new Map(data.runs.map(run => [run.run_id, run]));
    this.scenes = new Map(data.scenes.map(scene => [scene.scenario_id, scene]));
    this.player = null;
    this.build();
    this.ended = new AbortController();
    document.addEventListener("keydown", event => this.key(event), { signal: this.ended.signal });
    this.show();
  }

  /* ---------- The page ---------- */

  build() {
    const { data } = this, press = (label, title, act) => element("button", { type: "button", title, onclick: act }, label);
    this.search = element("input", { type: "search", placeholder: "scenario, run, reason", "aria-label": "search", title: "Search (/)", oninput: () => this.set({ text: this.search.value }) });
    const outcomes = [...new Set(data.runs.map(run => run.outcome))].sort();
    this.outcome = element("select", { "aria-label": "outcome", onchange: () => this.set({ outcome: this.outcome.value }) },
      element("option", { value: "" }, "every outcome"), ...outcomes.map(one => element("option", { value: one }, `${words(one)} (${data.runs.filter(run => run.outcome === one).length})`)));
    const flips = data.runs.filter(run => run.flip).length;
    this.flips = press(`Flips (${flips})`, "Rows with an outcome other than in the first column (X)", () => this.set({ flips: !this.filter.flips }));
    this.failures = press("Failures", "Rows with a failed run (Z)", () => this.set({ failures: !this.filter.failures }));
    this.shape = press("Table", "Grid or table (G)", () => this.reshape());
    this.count = element("span", { className: "muted", role: "status" });
    const tools = element("div", { className: "transport", role: "toolbar", "aria-label": "filters" }, this.search, this.outcome, this.flips, this.failures, this.shape,
      press("All", "Show everything (R)", () => this.reset()), this.count);
    this.list = element("div", { className: "list" });
    this.detail = element("section", { "aria-live": "polite" });
    const keys = element("section", {}, element("details", {}, element("summary", {}, "Keys"), element("table", {}, element("tbody", {},
      ...BOARD_KEYS.map(([key, what]) => element("tr", {}, element("td", {}, key), element("td", {}, what)))))));
    const lost = data.lost.length ? element("section", {}, element("h2", {}, `Lost: ${data.lost.length}`), ...data.lost.slice(0, 20).map(one => element("p", {}, one))) : null;
    const header = element("header", {}, element("div", { className: "ids" }, element("h1", {}, data.title)),
      press("Dark / light", "Dark or light (T)", () => setTheme(isDark() ? "light" : "dark")), ...data.notes.map(note => element("p", { className: "muted" }, note)));
    const side = element("div", { className: "side" }, this.detail, lost, keys);
    this.board = element("div", { className: "player board" }, header, element("div", { className: "body" }, this.summary(), tools, this.list), side);
    this.stage = element("div", { hidden: true });
    this.root.replaceChildren(this.board, this.stage);
    this.board.board = this;
  }

  /* A bar for each column with the outcomes of its runs. */
  summary() {
    const bars = this.data.columns.map(column => {
      const total = Object.values(column.outcomes).reduce((sum, count) => sum + count, 0);
      const parts = Object.entries(column.outcomes).map(([outcome, count]) => {
        const part = element("button", { type: "button", title: `${words(outcome)}: ${count} of ${total}`, onclick: () => { this.outcome.value = outcome; this.set({ outcome }); } }, element("span", {}, `${count} ${words(outcome)}`));
        part.style.flexGrow = count;
        part.style.setProperty("--outcome", `var(--${outcome})`);
        return part;
      });
      return element("div", { className: "column" }, element("b", {}, column.title), " ", element("span", { className: "muted" }, column.success), element("div", { className: "bar" }, ...parts));
    });
    return element("div", { className: "summary" }, ...bars);
  }

  /* ---------- Visible rows ---------- */

  matches(run) {
    const { text, outcome } = this.filter, row = this.data.rows[run.row];
    if (outcome && run.outcome !== outcome) return false;
    const searched = `${row.title} ${row.about} ${run.run_id} ${words(run.outcome)} ${run.ending} ${this.data.columns[run.column].title}`.toLowerCase();
    return text.toLowerCase().split(/\s+/).every(word => searched.includes(word));
  }

  /* The rows with a matching run, each with all its runs; only rows with flips or failures if selected. */
  rowsShown() {
    const rows = new Map();
    for (const run of this.data.runs) {
      if (!rows.has(run.row)) rows.set(run.row, { row: run.row, runs: [], matches: false });
      const entry = rows.get(run.row);
      entry.runs.push(run);
      if (this.matches(run) && (!this.filter.flips || run.flip) && (!this.filter.failures || (run.outcome !== GOOD && run.outcome !== "invalid"))) entry.matches = true;
    }
    return [...rows.values()].filter(entry => entry.matches);
  }

  show() {
    this.flips.setAttribute("aria-pressed", this.filter.flips);
    this.failures.setAttribute("aria-pressed", this.filter.failures);
    this.shape.textContent = this.asTable ? "Grid" : "Table";
    const rows = this.rowsShown();
    this.cells = new Map();
    this.list.replaceChildren(rows.length ? (this.asTable ? this.table(rows) : this.grid(rows)) : element("p", { className: "message" }, "No run matches. R shows everything."));
    const shown = rows.reduce((sum, entry) => sum + entry.runs.length, 0);
    this.count.textContent = `${rows.length} of ${this.data.rows.length} scenarios, ${shown} of ${this.data.runs.length} runs`;
    if (!this.cells.has(this.current)) this.current = this.cells.keys().next().value ?? null;
    this.mark();
  }

  grid(rows) {
    const head = element("tr", {}, element("th", { scope: "col" }, "scenario"), ...this.data.columns.map(column => element("th", { scope: "col" }, column.title)));
    this.order = rows.map(() => this.data.columns.map(() => null));
    const body = rows.map((entry, y) => {
      const cells = this.data.columns.map((_, x) => {
        const runs = entry.runs.filter(run => run.column === x);
        if (runs.length) this.order[y][x] = runs[0].run_id;
        return element("td", {}, ...(runs.length ? runs.map(run => this.cell(run, words(run.outcome))) : [element("span", { className: "muted" }, "no run")]));
      });
      const row = this.data.rows[entry.row];
      return element("tr", {}, element("th", { scope: "row" }, row.title, element("div", { className: "muted about" }, row.about)), ...cells);
    });
    return element("table", { className: "grid" }, element("thead", {}, head), element("tbody", {}, ...body));
  }

  cell(run, text) {
    const cell = element("button", { type: "button", className: "cell", tabIndex: -1, title: run.ending, onclick: event => this.open(run, event.shiftKey), onfocus: () => { this.current = run.run_id; this.mark(); } }, text);
    cell.style.setProperty("--outcome", `var(--${run.outcome})`);
    if (!this.matches(run)) cell.classList.add("dim");
    if (run.flip) cell.append(" ", element("span", { className: "flip", title: FLIPS[run.flip][1] }, FLIPS[run.flip][0]));
    this.cells.set(run.run_id, cell);
    return cell;
  }

  table(rows) {
    const { metrics, columns } = this.data, runs = rows.flatMap(entry => entry.runs).filter(run => this.matches(run)), { by, up } = this.sorted;
    const keys = { run: run => run.run_id, scenario: run => this.data.rows[run.row].title, configuration: run => columns[run.column].title };
    const key = keys[by] ?? (by === "" ? null : run => run.values[by]);
    if (key) runs.sort((a, b) => { const x = key(a), y = key(b); return x === null ? 1 : y === null ? -1 : (x < y ? -1 : x > y ? 1 : 0) * (up ? 1 : -1); });
    const head = (name, at, number) => element("th", { scope: "col", className: number ? "number" : "", "aria-sort": by === at ? (up ? "ascending" : "descending") : "none" },
      element("button", { type: "button", onclick: () => { this.sorted = { by: at, up: by === at ? !up : true }; this.show(); } }, `${name}${by === at ? (up ? " ↑" : " ↓") : ""}`));
    this.order = runs.map(run => [run.run_id]);
    const body = runs.map(run => element("tr", {}, element("td", {}, this.cell(run, words(run.outcome))), element("td", {}, this.data.rows[run.row].title), element("td", {}, columns[run.column].title),
      ...run.values.map(value => element("td", { className: "number" }, value === null ? "–" : String(value)))));
    return element("div", { className: "wide" }, element("table", {}, element("thead", {}, element("tr", {}, element("th", { scope: "col" }, "outcome"), head("scenario", "scenario"), head("configuration", "configuration"),
      ...metrics.map((metric, i) => head(`${metric.words}${metric.unit === "1" ? "" : ` (${metric.unit})`}`, i, true)))), element("tbody", {}, ...body)));
  }

  /* The current run: Tab reaches its cell, and its data are next to the grid. */
  mark() {
    for (const [id, cell] of this.cells) { cell.tabIndex = id === this.current ? 0 : -1; cell.classList.toggle("current", id === this.current); }
    const run = this.byId.get(this.current);
    if (!run || !this.cells.has(this.current)) { this.detail.replaceChildren(element("p", { className: "muted" }, "No run is selected.")); return; }
    const { metrics, columns, rows } = this.data, first = this.firstOf(run);
    const lines = metrics.map((metric, i) => [metric, run.values[i], first?.values[i]]).filter(([, value]) => value !== null);
    const head = element("tr", {}, element("th", { scope: "col" }, "metric"), element("th", { scope: "col", className: "number" }, "here"), first ? element("th", { scope: "col", className: "number" }, "first column") : null);
    const unit = metric => metric.unit === "1" ? "" : ` ${metric.unit}`;
    const body = lines.map(([metric, value, other]) => element("tr", {}, element("th", { scope: "row" }, metric.words), element("td", { className: "number" }, `${value}${unit(metric)}`), first ? element("td", { className: "number" }, other === null ? "–" : `${other}${unit(metric)}`) : null));
    const buttons = element("p", {}, element("button", { type: "button", onclick: () => this.open(run, false) }, "Open in the player"), " ", first ? element("button", { type: "button", onclick: () => this.open(run, true) }, "Next to the first column") : null);
    this.detail.replaceChildren(element("h2", {}, run.run_id), element("p", {}, outcomeMark(run.outcome), ` ${run.flip ? FLIPS[run.flip][1] : ""}`), element("p", {}, run.ending),
      element("p", { className: "muted" }, `${columns[run.column].title} on ${rows[run.row].title}`), buttons, element("table", {}, element("thead", {}, head), element("tbody", {}, ...body)));
  }

  firstOf(run) { return run.column === 0 ? undefined : this.data.runs.find(one => one.row === run.row && one.column === 0); }

  /* ---------- Actions ---------- */

  set(changes) { Object.assign(this.filter, changes); this.show(); }

  reset() {
    this.filter = { text: "", outcome: "", flips: false, failures: false };
    this.search.value = this.outcome.value = "";
    this.show();
  }

  reshape() { this.asTable = !this.asTable; this.show(); }

  async open(run, beside) {
    this.current = run.run_id;
    this.mark();
    const first = beside ? this.firstOf(run) : undefined, shown = [first, run].filter(Boolean);
    const data = this.playerOf(shown) ?? await this.requestPlayer(shown);
    if (!data) return;
    this.player?.destroy();
    this.scrolled = scrollY;
    this.board.hidden = true;
    this.stage.hidden = false;
    const back = element("button", { type: "button", onclick: () => this.close() }, "Back to the board (Esc)"), root = element("div");
    this.stage.replaceChildren(element("p", {}, back), root);
    this.player = new Player(root, data, this.tell);
    this.tell(`run ${run.run_id} on ${this.data.rows[run.row].title}: ${words(run.outcome)}`);
  }

  /* The board's data of some runs on one scenario; null if one of them is missing. */
  playerOf(runs) {
    const scene = this.scenes.get(this.data.rows[runs[0].row].scenario_id);
    if (!scene || runs.some(run => !this.data.drives[run.run_id])) return null;
    const panes = runs.map(run => ({ title: this.data.columns[run.column].title, scenario_id: scene.scenario_id, drive: this.data.drives[run.run_id] }));
    return { kind: "player", title: runs.map(run => run.run_id).join(" | "), scenes: [scene], panes, notes: [] };
  }

  async requestPlayer(runs) {
    const ids = runs.map(run => run.run_id);
    if (this.host) {
      try { return await this.host.read(`plannerforge://view/${ids.join("+")}`); } catch (error) { this.detail.prepend(element("p", {}, `Cannot read the run: ${error.message}`)); return null; }
    }
    this.detail.prepend(element("p", {}, `This file lacks the driven motion. To see it, run: plannerforge view ${ids.join(" ")}`));
    return null;
  }

  close() {
    this.player.destroy();
    this.player = null;
    this.stage.hidden = true;
    this.stage.replaceChildren();
    this.board.hidden = false;
    scrollTo(0, this.scrolled);
    this.cells.get(this.current)?.focus({ preventScroll: true });
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (this.player) {
      if (event.key === "Escape" && this.player.panes.every(pane => pane.selected === null)) { this.close(); event.preventDefault(); }
      return;
    }
    const typing = event.target === this.search, kind = event.target.tagName;
    if (typing && event.key === "Escape") { this.search.blur(); return; }
    if (typing || kind === "SELECT") return;
    const actions = {
      "ArrowLeft": () => this.go(-1, 0), "ArrowRight": () => this.go(1, 0), "ArrowUp": () => this.go(0, -1), "ArrowDown": () => this.go(0, 1), "/": () => this.search.focus(),
      "x": () => this.set({ flips: !this.filter.flips }), "z": () => this.set({ failures: !this.filter.failures }), "g": () => this.reshape(), "r": () => this.reset(), "t": () => setTheme(isDark() ? "light" : "dark"),
    };
    if (event.key === "Enter" && (kind === "BODY" || event.target.classList.contains("cell"))) actions.Enter = () => this.byId.has(this.current) && this.open(this.byId.get(this.current), event.shiftKey);
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (action) { action(); event.preventDefault(); }
  }

  /* Move to the next cell with a run, in a direction. */
  go(dx, dy) {
    let y = this.order.findIndex(row => row.includes(this.current)), x = y < 0 ? 0 : this.order[y].indexOf(this.current);
    if (y < 0) { y = 0; dx = dy = 0; }
    do { x += dx; y += dy; } while (this.order[y] && x in this.order[y] && this.order[y][x] === null && (dx || dy));
    const id = this.order[y]?.[x];
    if (id) this.cells.get(id).focus();
  }

  destroy() {
    this.player?.destroy();
    this.ended.abort();
  }
}

VIEWS.board = Board;
