"""Shell completion for hosts, tools and the artifacts of the workspace; it reads only what is quick to read.

Each function returns all candidates with a short description; typer keeps those that match the typed prefix.
"""

from pathlib import Path

import typer

from ..schemas.errors import PlannerForgeError
from .flags import settings_from

_MOST_IDS = 50
"""Newest artifacts of each kind that are offered (chosen: more than fit on a screen do not help)."""


def hosts() -> list[tuple[str, str]]:
    """Return the hosts with their titles."""
    from .hosts import HOSTS

    return [(name, host.title) for name, host in HOSTS.items()]


def tools() -> list[tuple[str, str]]:
    """Return the tools with their titles."""
    from ..tools.registry import TOOLS

    return [(spec.name, spec.title) for spec in TOOLS]


def viewed(context: typer.Context) -> list[tuple[str, str]]:
    """Return the artifacts that ``view`` shows, newest first per kind; a missing workspace is not created."""
    from ..engine.workspace import VIEWED_KINDS, Workspace

    named = context.params.get("workspace")
    root = settings_from(workspace=Path(named) if named else None).workspace.expanduser().resolve()
    if not (root / "workspace.sqlite").is_file():
        return []
    try:
        workspace = Workspace(root)
    except PlannerForgeError:  # completion cannot show the reason; the command itself does
        return []
    try:
        found = [each for kind in VIEWED_KINDS for each in workspace.newest(kind=kind, limit=_MOST_IDS)]
    finally:
        workspace.close()
    return [(each.artifact_id, each.name or each.kind) for each in found]
