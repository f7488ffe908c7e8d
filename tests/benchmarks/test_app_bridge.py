"""The judge of pages in a host: it passes them as they are, and names what is broken in one that was spoilt.

No network: the bridge and the client of npm are stood in for by modules that speak the same JSON-RPC by postMessage.
"""

import http.server
import json
import threading
import urllib.request
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest
from support.builders import town_road
from support.runs import DEFAULT, SAFE, record, source

from benchmarks.harness import LeftOut
from benchmarks.serve import app_bridge
from benchmarks.serve.app_bridge import Case, checks, looked_at
from benchmarks.serve.app_bridge.serving import Host, host
from benchmarks.serve.browser import Browser, chromium, find_chromium
from benchmarks.serve.node import Node, node_in
from plannerforge.engine.execution import silent
from plannerforge.engine.rendering import empty_page, write_view
from plannerforge.schemas.planning import RunPlans, ShownPlan
from plannerforge.schemas.rendering import ViewKind, ViewPane, ViewRequest
from plannerforge.schemas.runs import RunSource, ScenarioSource

needs_browser = pytest.mark.skipif(find_chromium() is None, reason="Chromium is not installed")
TOWN = "ZAM_Builder-1_1_T-1"
STAND_IN = """
export const RESOURCE_MIME_TYPE = "text/html;profile=mcp-app";
export const getToolUiResourceUri = tool => tool._meta.ui.resourceUri;

export class StreamableHTTPClientTransport {}

export class Client {
  async connect() { this.answers = await (await fetch("answers.json")).json(); }
  getServerCapabilities() { return { tools: {}, resources: {} }; }
  async listTools() { return { tools: this.answers.tools }; }
  async callTool({ name }) { return this.answers.results[name]; }
  async readResource({ uri }) {
    const text = this.answers.resources[uri];
    if (text === undefined) throw new Error(`there is no ${uri}`);
    return { contents: [{ uri, text, mimeType: RESOURCE_MIME_TYPE }] };
  }
}

export class PostMessageTransport {
  constructor(target, source) {
    addEventListener("message", event => { if (event.source === source) this.onmessage(event.data); });
    this.target = target;
  }
  async send(message) { this.target.postMessage(message, "*"); }
}

export class AppBridge {
  constructor(client, info, capabilities, { hostContext }) {
    Object.assign(this, { client, info, capabilities, context: hostContext, count: 0, waiting: new Map() });
  }
  async connect(transport) { this.transport = transport; transport.onmessage = message => this.receive(message); }
  async receive({ id, method, params, result, error }) {
    if (method === undefined) { this.waiting.get(id)(result ?? error); return; }
    const answers = {
      "ui/initialize": () => {
        this.app = params.appInfo;
        const own = { hostInfo: this.info, hostCapabilities: this.capabilities, hostContext: this.context };
        return { protocolVersion: "2026-01-26", ...own };
      },
      "resources/read": () => this.client.readResource(params),
      "ui/update-model-context": () => this.onupdatemodelcontext(params),
    };
    if (method === "ui/notifications/initialized") this.oninitialized();
    if (method === "ui/notifications/size-changed") this.onsizechange(params);
    if (id === undefined) return;
    try { this.transport.send({ jsonrpc: "2.0", id, result: await answers[method]() }); }
    catch (fault) { this.transport.send({ jsonrpc: "2.0", id, error: { code: -32603, message: fault.message } }); }
  }
  async tell(name, params) { this.transport.send({ jsonrpc: "2.0", method: `ui/notifications/${name}`, params }); }
  getAppVersion() { return this.app; }
  sendSandboxResourceReady(params) { return this.tell("sandbox-resource-ready", params); }
  sendToolInput(params) { return this.tell("tool-input", params); }
  sendToolResult(params) { return this.tell("tool-result", params); }
  sendToolCancelled(params) { return this.tell("tool-cancelled", params); }
  setHostContext(context) { this.tell("host-context-changed", context); }
  teardownResource(params) {
    const id = ++this.count;
    this.transport.send({ jsonrpc: "2.0", id, method: "ui/resource-teardown", params });
    return new Promise(done => this.waiting.set(id, done));
  }
}
"""
IMPORTS = {
    "imports": dict.fromkeys(
        ("@modelcontextprotocol/ext-apps/app-bridge", "@modelcontextprotocol/client"), "./stand_in.js"
    )
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("bridge")


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def views(folder: Path) -> Mapping[str, str]:
    """The data of views by their URI: a run with plans, a batch of it and another."""
    town = ScenarioSource(scenario_id=TOWN, path=str(town_road().write(folder / "town.xml")))
    plans = tuple(ShownPlan(step=step, plan=(0.0, 0.0, 90.0, 0.0)) for step in (0, 9))
    (folder / "plans.json").write_text(RunPlans(plans=plans).model_dump_json())
    runs = [
        source(record(TOWN, "collision", DEFAULT, obstacle_id=31), folder, velocity_offset=3.0),
        source(record(TOWN, "goal_reached", SAFE), folder),
    ]
    pane = ViewPane(scenario=town, run=runs[0], plans_path=str(folder / "plans.json"))

    def data(name: str, kind: ViewKind, shown_runs: tuple[RunSource, ...], *panes: ViewPane) -> str:
        path = str(folder / f"view_{name}.json")
        request = ViewRequest(
            kind=kind, title=name, panes=panes, runs=shown_runs, scenarios=(town,), path=path, whole=False
        )
        return Path(write_view(request, silent).path).read_text(encoding="utf-8")

    both = [ViewPane(scenario=town, run=run) for run in runs]
    names = [run.record.run_id for run in runs]
    return {
        "plannerforge://view/run": data("run", "player", (), pane),
        "plannerforge://view/board": data("board", "board", tuple(runs)),
        **{f"plannerforge://view/{name}": data(name, "player", (), one) for name, one in zip(names, both, strict=True)},
        f"plannerforge://view/{'+'.join(names)}": data("both", "player", (), *both),
    }


@contextmanager
def standing_in(views: Mapping[str, str], page: str) -> Iterator[Host]:
    """The judge's host with a bridge of its own, and tools whose answers name the views."""
    uri = "ui://plannerforge/board.html"
    answers = {
        "tools": [{"name": name, "_meta": {"ui": {"resourceUri": uri}}} for name in ("run", "board", "refused")],
        "results": {
            **{
                name: {"content": [], "_meta": {"plannerforge/view": f"plannerforge://view/{name}"}}
                for name in ("run", "board")
            },
            "refused": {"content": [], "isError": True},
        },
        "resources": {uri: page, **views},
    }
    opening = f'<script type="importmap">{json.dumps(IMPORTS)}</script><script type="module"'
    files = {
        "host.html": app_bridge.part("host.html").replace(b'<script type="module"', opening.encode()),
        "host.js": app_bridge.part("host.js"),
        "stand_in.js": STAND_IN.encode(),
        "answers.json": json.dumps(answers).encode(),
    }
    with host(files, app_bridge.part("sandbox.html")) as served:
        yield served


def looked_into(
    browser: Browser, views: Mapping[str, str], page: str, case: Case, width: int, patience_s: float = 4.0
) -> list[checks.Check]:
    with standing_in(views, page) as served:
        found, _ = looked_at(browser, served, case, width, "light", patience_s=patience_s)
    return found


def failed(found: list[checks.Check]) -> list[str]:
    return [words for words, holds in found if not holds]


@needs_browser
@pytest.mark.parametrize(
    ("case", "width"),
    [(Case("run", "run", {}, "car"), 420), (Case("board", "board", {}), 420), (Case("refusal", "refused", {}), 420)],
)
def test_pages_as_they_are_pass(browser: Browser, views: Mapping[str, str], case: Case, width: int) -> None:
    found = looked_into(browser, views, empty_page("board"), case, width)
    assert len(found) > 5
    assert failed(found) == []


SPOILT: Sequence[Mapping[str, tuple[str, str]]] = (
    {"reports its size": ('"ui/notifications/size-changed"', '"ui/notifications/size"')},
    {
        "theme of the host": ("setTheme(context.theme)", "setTheme('dark')"),
        "space plays": ('" ": () => this.toggle()', '" ": () => null'),
        "slider": ("oninput: () => this.seek(", "oninput: () => Math.abs("),
        "F follows the ego": ("if (this.follow) this.centre(pane);", ""),
        "learns what the user looks at": ('this.request("ui/update-model-context"', 'this.request("ui/model-context"'),
        "0.6 of the width": ("else if (this.whole) this.fit();", ""),
        "O hides the plans": ("if (showPlans) drawPlan", "drawPlan"),
        "no script and no message failed": (
            "begin();\n</script>",
            "begin(); setTimeout(() => { throw Error(); });\n</script>",
        ),
    },
    {
        "wider than the host": ("main { padding: 10px 14px 14px; }", "main { width: 2000px; }"),
        "a click shows": ("if (held.delete(event.pointerId)", "if (false"),
        "in full screen": ("dataset.host = context.displayMode", "dataset.shown = context.displayMode"),
        "no listener left": ("this.ended.abort();", ""),
        "what was hidden": ("this.panes.every(pane => pane.camera.scale > 0)", "true"),
        "nothing came from elsewhere": ('<main id="view">', '<img src="http://127.0.0.1:9/x.png"><main id="view">'),
    },
)
"""Of pages that are broken: by words of each check that has to fail, what is replaced by what."""


@needs_browser
@pytest.mark.parametrize("spoilt", SPOILT, ids=[next(iter(spoilt)) for spoilt in SPOILT])
def test_broken_parts_of_a_page_are_named(
    browser: Browser, views: Mapping[str, str], spoilt: Mapping[str, tuple[str, str]]
) -> None:
    page = empty_page("board")
    for whole, broken in spoilt.values():
        assert whole in page
        page = page.replace(whole, broken)
    found = failed(looked_into(browser, views, page, Case("run", "run", {}, "car"), 1280, patience_s=0.4))
    assert [words for words in spoilt if not any(words in one for one in found)] == []


@needs_browser
def test_a_page_without_its_handshake_is_one_failed_check(browser: Browser, views: Mapping[str, str]) -> None:
    ((words, holds),) = looked_into(browser, views, "<!DOCTYPE html><p>silent", Case("run", "run", {}), 1280, 0.4)
    assert "does not say that it is ready" in words
    assert not holds


class Told(http.server.BaseHTTPRequestHandler):
    """A server that says which headers and body it got, in two parts."""

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.send_response(202)
        self.send_header("Mcp-Session-Id", "7")
        self.end_headers()
        for part in (json.dumps(sorted(name.lower() for name in self.headers)).encode(), b"\n" + body):
            self.wfile.write(part)
            self.wfile.flush()

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - the name that the library gives it
        """Say nothing."""


def test_host_passes_requests_on_and_the_sandbox_has_a_policy() -> None:
    server = http.server.HTTPServer(("127.0.0.1", 0), Told)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with host({"host.html": b"here"}, b"sand", f"http://127.0.0.1:{server.server_port}/mcp") as served:
        url = f"{served.url.rpartition('/')[0]}/mcp"
        request = urllib.request.Request(url, b"asked", {"Origin": "http://here", "Mcp-Method": "ping"})
        with urllib.request.urlopen(request) as answer:
            names, body = answer.read().split(b"\n")
            assert (answer.status, answer.headers["Mcp-Session-Id"], body) == (202, "7", b"asked")
        assert "mcp-method" in json.loads(names)
        assert "origin" not in json.loads(names)
        with urllib.request.urlopen(served.sandbox) as page:
            assert "connect-src 'none'" in page.headers["Content-Security-Policy"]
            assert page.read() == b"sand"
        with urllib.request.urlopen(served.url) as page:
            assert page.headers["Content-Security-Policy"] is None
    server.shutdown()
    server.server_close()


def test_bridge_is_left_out_with_the_reason_of_npm(tmp_path: Path) -> None:
    with pytest.raises(LeftOut, match="no-such-node does not exist"):
        node_in(tmp_path, "no-such-node")
    program = tmp_path / "bin" / "node"
    npm = tmp_path / "lib" / "node_modules" / "npm" / "bin" / "npm-cli.js"
    for path, text in ((program, "#!/bin/sh\necho no network >&2; exit 1\n"), (npm, "")):
        path.parent.mkdir(parents=True)
        path.write_text(text)
    program.chmod(0o755)
    assert node_in(tmp_path, str(program)) == Node(program)
    with pytest.raises(LeftOut, match=r"the bridge cannot be installed by npm: no network"):
        app_bridge.bundle(tmp_path / "folder", str(program))
