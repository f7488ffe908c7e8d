/* Starts the page with its own data, or with those of an MCP host (MCP Apps, JSON-RPC by postMessage). */

const APPS_PROTOCOL = "2026-01-26";
const VIEW_KEY = "plannerforge/view";

/* ---------- Themes ---------- */

const isDark = () => (document.documentElement.dataset.theme ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light")) === "dark";

function setTheme(theme) {
  document.documentElement.dataset.theme = theme;
  dispatchEvent(new Event("themechange"));
}

/* ---------- The host ---------- */

class Host {
  constructor(onView, onWords) {
    Object.assign(this, { onView, onWords });
    this.results = 0;
    this.waiting = new Map();
    this.count = 0;
    this.capabilities = {};
    addEventListener("message", event => { if (event.source === parent && event.data?.jsonrpc === "2.0") this.receive(event.data); });
  }

  send(message) { parent.postMessage({ jsonrpc: "2.0", ...message }, "*"); }

  request(method, params) {
    const id = ++this.count;
    this.send({ id, method, params });
    return new Promise((resolve, reject) => this.waiting.set(id, { resolve, reject }));
  }

  async connect() {
    const answer = await this.request("ui/initialize", { protocolVersion: APPS_PROTOCOL, appInfo: { name: "plannerforge-view", version: "1" }, appCapabilities: { availableDisplayModes: ["inline", "fullscreen"] } });
    this.capabilities = answer.hostCapabilities ?? {};
    this.adopt(answer.hostContext ?? {});
    this.send({ method: "ui/notifications/initialized" });
    const reportSize = () => this.send({ method: "ui/notifications/size-changed", params: { width: document.documentElement.scrollWidth, height: Math.ceil(document.body.getBoundingClientRect().height) } });
    new ResizeObserver(reportSize).observe(document.body);
  }

  /* In full screen the page fills its window; otherwise the window takes the height of the page, so nothing may depend on it. */
  adopt(context) {
    if (context.theme === "dark" || context.theme === "light") setTheme(context.theme);
    if (context.displayMode) document.documentElement.dataset.host = context.displayMode;
  }

  receive(message) {
    if (message.method === undefined) {
      const waiting = this.waiting.get(message.id);
      this.waiting.delete(message.id);
      if (waiting) message.error ? waiting.reject(new Error(message.error.message)) : waiting.resolve(message.result);
    } else if (message.method === "ui/notifications/tool-result") this.toolResult(message.params);
    else if (message.method === "ui/notifications/tool-cancelled") { this.results += 1; this.onWords("The call was cancelled."); }
    else if (message.method === "ui/notifications/host-context-changed") this.adopt(message.params ?? {});
    else if (message.method === "ui/resource-teardown" || message.method === "ping") this.send({ id: message.id, result: {} });
    else if (message.id !== undefined) this.send({ id: message.id, error: { code: -32601, message: "Method not found" } });
  }

  /* A tool's result gives its view; the data come as a resource, not through the model. */
  async toolResult(result) {
    const uri = result._meta?.[VIEW_KEY], number = ++this.results, isLast = () => number === this.results;
    if (!uri) { this.onWords(result.isError ? "The call was refused, so there is nothing to show." : "This answer has no view."); return; }
    this.onWords("Reading the view.");
    try { const data = await this.read(uri); if (isLast()) this.onView(data); } catch (error) { if (isLast()) this.onWords(`Cannot read the view: ${error.message}`); }
  }

  async read(uri) {
    const answer = await this.request("resources/read", { uri });
    return JSON.parse(answer.contents[0].text);
  }

  /* The user's current view, for the model's next turn if the host passes it on. */
  tell(text) {
    if (this.capabilities.updateModelContext) this.request("ui/update-model-context", { content: [{ type: "text", text: `The user looks at ${text}` }] }).catch(() => {});
  }
}

/* ---------- Start ---------- */

function say(text) { document.getElementById("view").replaceChildren(element("p", { className: "message", role: "status" }, text)); }

function begin() {
  const own = document.getElementById("data").textContent.trim();
  let shown = null;
  const words = text => { shown?.destroy(); shown = null; say(text); };
  const show = (data, host) => {
    shown?.destroy();
    const root = document.getElementById("view"), tell = text => host?.tell(text);
    if (!VIEWS[data.kind]) { say(`This page cannot show a ${data.kind}.`); return; }
    shown = new VIEWS[data.kind](root, data, tell, host);
  };
  if (own) { show(JSON.parse(own), null); return; }
  if (parent === window) { say("This page has no data. Open it in an MCP host, or write it with plannerforge view."); return; }
  document.documentElement.dataset.host = "inline";
  const host = new Host(data => show(data, host), words);
  say("Waiting for the host.");
  host.connect().then(() => { if (!host.results) say("Waiting for an answer to show."); }, error => say(`The host refused: ${error.message}`));
}

begin();
