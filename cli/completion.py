"""What a shell completes at a TAB: hosts, tools, and what the workspace holds. Only what is quick is looked at.

Each function gives all there is with a word on it; typer keeps what begins as was typed.
"""

from pathlib import Path

import typer

from ..schemas.errors import PlannerForgeError
from .flags import settings_from

_MOST_IDS = 50
"""The newest of each kind that are offered; chosen: more than a screen shows do not help."""


def hosts() -> list[tuple[str, str]]:
    """The hosts with their titles."""
    from .hosts import HOSTS

    return [(name, host.title) for name, host in HOSTS.items()]


def tools() -> list[tuple[str, str]]:
    """The tools with their titles."""
    from ..tools.registry import TOOLS

    return [(spec.name, spec.title) for spec in TOOLS]


def viewed(context: typer.Context) -> list[tuple[str, str]]:
    """What ``view`` shows of the workspace that is meant, newest first of each kind; a workspace is not made."""
    from ..engine.workspace import VIEWED_KINDS, Workspace

    named = context.params.get("workspace")
    root = settings_from(workspace=Path(named) if named else None).workspace.expanduser().resolve()
    if not (root / "workspace.sqlite").is_file():
        return []
    try:
        workspace = Workspace(root)
    except PlannerForgeError:  # a TAB has no place for the reason; the command itself gives it
        return []
    try:
        found = [each for kind in VIEWED_KINDS for each in workspace.newest(kind=kind, limit=_MOST_IDS)]
    finally:
        workspace.close()
    return [(each.artifact_id, each.name or each.kind) for each in found]
