/* A host of MCP Apps as the judge drives it: the bridge and the client are those of npm, the rest notes what it sees. */

import { AppBridge, PostMessageTransport, RESOURCE_MIME_TYPE, getToolUiResourceUri } from "@modelcontextprotocol/ext-apps/app-bridge";
import { Client, StreamableHTTPClientTransport } from "@modelcontextprotocol/client";

const INFO = { name: "plannerforge-judge", version: "1" };
const PATIENCE_MS = 10000;
const box = document.getElementById("box");

class Host {
  constructor() {
    this.received = [];  /* what the page sent, { at, message } */
    this.sent = [];      /* what the bridge sent */
    this.sizes = [];
    this.told = [];      /* contexts for the model */
    this.opened = [];    /* links and messages */
    this.faults = [];
  }

  async connect(mode) {
    const capabilities = { extensions: { "io.modelcontextprotocol/ui": { mimeTypes: [RESOURCE_MIME_TYPE] } } };
    this.client = new Client(INFO, { capabilities, versionNegotiation: { mode } });
    await this.client.connect(new StreamableHTTPClientTransport(new URL("/mcp", location.href)));
    this.tools = new Map((await this.client.listTools()).tools.map(tool => [tool.name, tool]));
    return this.client.getNegotiatedProtocolVersion?.() ?? "";
  }

  /* A tool is called and its page shown, as a host does it; the answer of the tool. */
  async show(name, input, context, sandbox) {
    const tool = this.tools.get(name), answer = this.client.callTool({ name, arguments: input });
    document.getElementById("tool").textContent = `${name} ${JSON.stringify(input)}`;
    const page = (await this.client.readResource({ uri: getToolUiResourceUri(tool) })).contents[0];
    if (page.mimeType !== RESOURCE_MIME_TYPE) throw new Error(`the page is ${page.mimeType}`);
    await this.load(page, { toolInfo: { tool }, ...context }, sandbox);
    await this.bridge.sendToolInput({ arguments: input });
    const result = await answer;
    this.answeredAt = performance.now();
    await this.bridge.sendToolResult(result);
    return { meta: result._meta ?? null, error: result.isError ?? false, text: result.content[0]?.text ?? "" };
  }

  /* The page in a sandbox of another origin, once it says that it is ready. */
  async load(page, context, sandbox) {
    document.documentElement.dataset.theme = context.theme;
    const frame = document.createElement("iframe");
    frame.setAttribute("sandbox", "allow-scripts allow-same-origin allow-forms");
    const ready = new Promise(done => addEventListener("message", ({ source, data }) => {
      if (source !== frame.contentWindow) return;
      if (data?.method === "ui/notifications/sandbox-proxy-ready") done();
      else this.received.push({ at: performance.now(), message: data });
    }));
    frame.src = sandbox;
    box.replaceChildren(frame);
    await ready;
    this.frame = frame;
    this.bridge = this.bridged(context);
    const initialized = new Promise(done => { this.bridge.oninitialized = done; });
    const transport = new Noting(frame.contentWindow, this.sent);
    await this.bridge.connect(transport);
    const passed = transport.onerror;
    transport.onerror = error => { this.faults.push(String(error)); passed?.(error); };
    const { csp, permissions } = page._meta?.ui ?? {};
    await this.bridge.sendSandboxResourceReady({ html: page.text, csp, permissions });
    await Promise.race([initialized, new Promise((_, fail) => setTimeout(() => fail(new Error("the page does not say that it is ready")), PATIENCE_MS))]);
  }

  bridged(context) {
    const served = this.client.getServerCapabilities();
    const capabilities = { openLinks: {}, serverTools: served.tools, serverResources: served.resources, updateModelContext: { text: {} }, message: { text: {} }, logging: {} };
    const bridge = new AppBridge(this.client, INFO, capabilities, { hostContext: context });
    this.context = context;
    bridge.onerror = error => { this.faults.push(String(error)); };
    bridge.onupdatemodelcontext = async ({ content }) => { this.told.push(content?.map(one => one.text).join("\n")); return {}; };
    bridge.onopenlink = async params => { this.opened.push(params); return {}; };
    bridge.onmessage = async params => { this.opened.push(params); return {}; };
    bridge.onsizechange = ({ width, height }) => {
      this.sizes.push({ width, height });
      if (width !== undefined) this.frame.style.minWidth = `min(${width}px, 100%)`;
      if (height !== undefined && this.context.displayMode !== "fullscreen") this.frame.style.height = `${height}px`;
    };
    return bridge;
  }

  /* Another context, as when the user chooses dark or full screen. */
  change(more) {
    this.context = { ...this.context, ...more };
    if (more.theme) document.documentElement.dataset.theme = more.theme;
    if (more.displayMode === "fullscreen") this.frame.style.height = `${more.containerDimensions.height}px`;
    if (more.displayMode === "inline") this.frame.style.height = `${this.sizes.at(-1).height}px`;
    this.bridge.setHostContext(this.context);
  }

  /* From the tool's answer to the data of the first view; nothing where none was read. */
  readMs() {
    const first = this.received.find(({ message }) => message.method === "resources/read");
    const reply = this.sent.find(({ message }) => message.id === first?.message.id && message.result);
    return reply ? [reply.at - this.answeredAt] : [];
  }

  /* Requests of the page by method, and whether each was answered with a result. */
  asked(method) {
    return this.received.filter(({ message }) => message.method === method).map(({ message }) => {
      const reply = this.sent.find(one => one.message.id === message.id && one.message.method === undefined);
      return { params: message.params, answered: Boolean(reply?.message.result), error: reply?.message.error?.message ?? "" };
    });
  }
}

/* The transport of npm, which notes what the bridge sends. */
class Noting extends PostMessageTransport {
  constructor(target, sent) { super(target, target); this.sent = sent; }

  async send(message, options) {
    this.sent.push({ at: performance.now(), message });
    return super.send(message, options);
  }
}

window.host = new Host();
