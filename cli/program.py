"""The server's part of the command line: ``plannerforge serve | call | view | tools | prompts | maps | planner | …``.

``cli/clients.py`` has the clients and ``cli/evaluation.py`` the evaluations; ``cli/main.py`` combines them. Commands
import what they need when they run, so that ``serve`` starts fast.
"""

import gc
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from .. import __version__
from ..schemas.errors import PlannerForgeError, leaves_of
from . import completion
from .catalog import catalog
from .flags import MapFolders, Roots, SettingsCommand, Workers, Workspace, settings_from, settings_of
from .maps import maps
from .planner import planner
from .workspace import workspace as workspace_commands

application = typer.Typer(
    name="plannerforge",
    help="Scenario-based testing of motion planners behind one MCP server.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)
application.add_typer(catalog)
application.add_typer(maps)
application.add_typer(planner)
application.add_typer(workspace_commands)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"plannerforge {__version__}")
        raise typer.Exit


@application.callback()
def _main(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    del version  # its callback printed it


def run(program: typer.Typer) -> None:
    """Run a command line; an error of this package ends it with its message and exit code 1, without a traceback."""
    messages: list[str] = []
    try:
        _narrow(program, sys.argv[1:2])()
    except* PlannerForgeError as failures:
        messages = [error.text for error in leaves_of(failures) if isinstance(error, PlannerForgeError)]
    if messages:
        typer.echo("\n".join(dict.fromkeys(messages)), err=True)
        raise SystemExit(1)


def _narrow(program: typer.Typer, words: Sequence[str]) -> typer.Typer:
    """Return the program with only the requested command; building the others would add 20 ms to every start."""
    commands = [info for info in program.registered_commands if info.callback and info.callback.__name__ in words]
    if not commands:
        return program
    narrowed = copy(program)
    narrowed.registered_commands, narrowed.registered_groups = commands, []
    return narrowed


_THREAD_STACK_BYTES = 2 * 1024**2
"""Counts as data memory as soon as a thread starts, used or not. With Linux's 8 MiB, a dozen simultaneous calls take
all of the smallest ``server_memory_mb``; threads have 512 KiB on macOS and 128 KiB with musl.
"""


@application.command(cls=SettingsCommand)
def serve(
    context: typer.Context,
    http: Annotated[bool, typer.Option("--http", help="Serve over HTTP, for several clients.")] = False,
) -> None:
    """Serve MCP over standard input and output, or over HTTP. Every setting except tokens is a flag."""
    gc.disable()  # imports leave nothing to collect, and the search for it took a sixth of the start
    from ..engine.execution import hide_environment, limit_memory, share_heaps
    from ..server.assembly import create_server

    settings = settings_of(context)
    hide_environment()
    limit_memory(settings.server_memory_mb * 1024**2)
    threading.stack_size(_THREAD_STACK_BYTES)
    share_heaps()
    server = create_server(settings)
    if http:
        from ..server.http.serving import serve_http

        _collect_again()
        serve_http(server, settings)
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # the SDK reads standard input in a thread that cannot be interrupted
    signal.signal(signal.SIGTERM, partial(_end, server.finish_journal))  # hosts send it 2 s after they disconnect
    _collect_again()
    server.run("stdio")


def _end(finish: Callable[[], None], number: int, frame: object) -> None:
    """Write what must not be lost, and end as the signal would have done."""
    del frame
    finish()
    signal.signal(number, signal.SIG_DFL)
    signal.raise_signal(number)


def _collect_again() -> None:
    gc.freeze()  # the imports stay for the life of the process
    gc.enable()


@application.command()
def call(
    tool: Annotated[
        str, typer.Argument(help="Name of the tool; `plannerforge tools` lists them.", autocompletion=completion.tools)
    ],
    arguments: Annotated[str, typer.Argument(help='Arguments as a JSON object, such as {"count": 2}.')] = "{}",
    as_json: Annotated[bool, typer.Option("--json", help="Print the structured answer.")] = False,
    workspace: Workspace = None,
    roots: Roots = None,
    map_folders: MapFolders = None,
    workers: Workers = None,
) -> None:
    """Make one tool call, as an MCP client does."""
    from .one_call import make_call

    settings = settings_from(workspace=workspace, roots=roots, map_folders=map_folders, workers=workers, warm_up=False)
    raise typer.Exit(make_call(settings, tool, arguments, as_json=as_json))


@application.command()
def token(
    name: Annotated[str, typer.Argument(help="Name of the token, for example in the journal.")],
    read_only: Annotated[
        bool, typer.Option("--read-only", help="Offer this token only tools that store nothing.")
    ] = False,
) -> None:
    """Create a bearer token for `serve --http`; the token is shown once, and only its digest is stored."""
    from ..server.http.access import new_token

    text, line = new_token(name, reads_only=read_only)
    typer.echo(f"The client sends: Authorization: Bearer {text}", err=True)
    typer.echo("The file of --token-file holds this line:", err=True)
    typer.echo(line)


@application.command()
def view(
    ids: Annotated[
        list[str],
        typer.Argument(help="A scenario, run or batch; or several of the first two.", autocompletion=completion.viewed),
    ],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the page to this file.")] = None,
    no_open: Annotated[
        bool, typer.Option("--no-open", help="Write the page and print its path, without opening it.")
    ] = False,
    workspace: Workspace = None,
) -> None:
    """Show a scenario or run in motion, two side by side, or the board of a batch, as one HTML file in the browser."""
    from .view import view_artifacts

    settings = settings_from(workspace=workspace, workers=1, warm_up=False)
    view_artifacts(ids, settings, output=output, open_it=not no_open)


@application.command()
def ui(
    port: Annotated[int | None, typer.Option(help="Port to listen on; 0: any free port [default: 8765].")] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Print the address without opening it.")] = False,
    workspace: Workspace = None,
    roots: Roots = None,
    map_folders: MapFolders = None,
    workers: Workers = None,
) -> None:
    """Serve the workspace as web pages: catalogue, scenarios, runs, batches and journal, together with MCP
    over HTTP.
    """
    from .ui import serve_pages

    settings = settings_from(workspace=workspace, roots=roots, map_folders=map_folders, workers=workers, http_port=port)
    serve_pages(settings, open_it=not no_open)


@application.command(name="tools")
def list_tools(
    essential: Annotated[bool, typer.Option("--essential", help="Only the set for small models.")] = False,
) -> None:
    """List the tools with their cost in tokens."""
    from .tool_costs import print_costs

    print_costs(settings_from(tools="essential" if essential else None))


@application.command()
def prompts(
    task: Annotated[
        str | None, typer.Argument(help="Print the prompt of this task; default: list the cost of all.")
    ] = None,
    condition: Annotated[str, typer.Option(help="baseline, cp, cp_cot, cp_icl or cp_icl_cot.")] = "cp_icl_cot",
) -> None:
    """List the prompts of the tasks with their cost in tokens, or print one."""
    from ..prompts.composition import system_prompt
    from .tool_costs import print_prompt_costs

    if task is None:
        print_prompt_costs()
        return
    try:
        typer.echo(system_prompt(task, condition))
    except PlannerForgeError as error:
        typer.echo(error.text, err=True)
        raise typer.Exit(1) from error


@application.command()
def check(
    files: Annotated[list[Path], typer.Argument(help="CommonRoad files.", exists=True, dir_okay=False)],
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Check the road networks of CommonRoad files; the exit code is 1 if one has errors."""
    from .check import check_files

    raise typer.Exit(check_files(files, as_json=as_json))


@application.command()
def doctor(
    as_json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
    fix: Annotated[bool, typer.Option("--fix", help="Apply safe repairs: workspace, text index, hosts.")] = False,
    workspace: Workspace = None,
    roots: Roots = None,
    map_folders: MapFolders = None,
) -> None:
    """Check everything that the server needs, and say how to repair it; the exit code is 1 if there is a fault."""
    from .doctor import run_doctor

    settings = settings_from(workspace=workspace, roots=roots, map_folders=map_folders)
    raise typer.Exit(run_doctor(settings, as_json=as_json, fix=fix, home=Path.home()))


@application.command()
def install(
    host: Annotated[
        str,
        typer.Argument(
            help="claude-desktop, claude-code, vscode, cursor, windsurf, codex, gemini or zed.",
            autocompletion=completion.hosts,
        ),
    ],
    print_only: Annotated[bool, typer.Option("--print", help="Print the entry without writing it.")] = False,
    workspace: Workspace = None,
    roots: Roots = None,
) -> None:
    """Add this server to the settings of an MCP host, and keep a backup of them."""
    from .hosts import install as install_into
    from .hosts import may_vanish, named_host, start_command

    if may_vanish(Path(sys.prefix)):
        typer.echo(
            "This program runs in uv's cache, which may be emptied, so the host starts it with uvx; "
            "`uv tool install plannerforge-mcp` creates a permanent environment.",
            err=True,
        )
    flags = ["--workspace", str(workspace.resolve())] if workspace else []
    flags += [part for root in roots or () for part in ("--roots", str(root.resolve()))]
    raise typer.Exit(install_into(named_host(host), start_command(flags), home=Path.home(), print_only=print_only))


@application.command()
def leaderboard(
    folder: Annotated[Path, typer.Argument(help="The folder of the page and its data.")] = Path("leaderboard"),
    planner: Annotated[list[str] | None, typer.Option(help="A planner, PLANNER[:PRESET]; all by default.")] = None,
    boundary: Annotated[list[str] | None, typer.Option(help="A logical scenario; all by default.")] = None,
    world: Annotated[list[str] | None, typer.Option(help="A world of the sensors; perfect by default.")] = None,
    points: Annotated[int, typer.Option(min=30, max=1000, help="The most points of each map.")] = 60,
    seed: Annotated[int, typer.Option(help="The seed of traffic, and of the choice of points.")] = 0,
    workspace: Workspace = None,
    workers: Workers = None,
) -> None:
    """Compare planners over the standard boundaries, and write one page with digests of everything.

    The same command continues after an interruption.
    """
    from ..schemas.leaderboard import LeaderboardRequest
    from .leaderboard import write_leaderboard

    given = {"planners": planner, "scenarios": boundary, "worlds": world}
    request = LeaderboardRequest.model_validate(
        {"points": points, "seed": seed, **{name: value for name, value in given.items() if value}}
    )
    settings = settings_from(workspace=workspace, roots=None, map_folders=None, workers=workers, warm_up=False)
    raise typer.Exit(write_leaderboard(request, folder, settings))


@application.command(name="test")
def run_tests(
    suite: Annotated[Path, typer.Argument(help="The suite, a YAML file.", exists=True, dir_okay=False)],
    junit: Annotated[Path | None, typer.Option(help="Write JUnit XML to this file.")] = None,
    summary: Annotated[Path | None, typer.Option(help="Write a summary in Markdown to this file.")] = None,
    report: Annotated[Path | None, typer.Option(help="Write the full report as JSON to this file.")] = None,
    save_baseline: Annotated[
        Path | None, typer.Option(help="Write the runs to this file, as the baseline of later suites.")
    ] = None,
    workspace: Workspace = None,
    map_folders: MapFolders = None,
    workers: Workers = None,
) -> None:
    """Run a test suite for planners; the exit code is 0 if all limits hold, 1 if one does not, and 2 if it
    cannot run.
    """
    from .suite import SuiteOutputs, test_suite

    roots = [suite.resolve().parent]
    settings = settings_from(workspace=workspace, roots=roots, map_folders=map_folders, workers=workers, warm_up=False)
    raise typer.Exit(test_suite(suite, settings, SuiteOutputs(junit, summary, report, save_baseline)))
