"""Finds the call that a refusal proposes: the first correction of the refused call that works, or a look-up call.

If a corrected call is refused for another reason, that fault is corrected too. Calls to tools that create nothing, and
those with a dry run, are tried before they are proposed.
"""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import anyio.lowlevel

from ...schemas.base import Arguments
from ...schemas.errors import (
    InvalidRequest,
    NextCall,
    OutsideRoots,
    PlannerForgeError,
    Remedy,
    UnexpectedFailure,
    error_to_report,
    followed,
    with_values,
)
from ...tools.call import ToolCall
from ...tools.registry import TOOLS, ToolSpec
from ...workflows.scenarios import one_scenario
from .checking import read_arguments
from .loose_reading import read_loosely

logger = logging.getLogger(__name__)
_MOST_TRIED = 8
"""Maximum corrected calls that are tried per refusal; chosen."""
_MOST_MENDED = 4
"""Maximum faults of a call that are corrected in sequence; chosen."""
TRYING_S = 10.0
"""Maximum time for all trials of a refusal, after which it has no proposal; chosen below the time that clients wait."""


async def proposed_call(
    error: PlannerForgeError,
    spec: ToolSpec,
    given: Mapping[str, Any],
    call: ToolCall,
    offered: Mapping[str, ToolSpec] | None = None,
) -> NextCall | None:
    """Return the call that helps after a refusal, or None.

    Args:
        error: the refusal.
        spec: the tool that was called.
        given: the arguments as sent.
        call: the resources of the call.
        offered: the tools that the client may call; only these are proposed. None means all.
    """
    tools = {tool.name: tool for tool in TOOLS} if offered is None else offered
    read = read_loosely(spec.arguments_type, given).values
    mended = None
    if spec.name in tools and spec.proposed:
        correction = _Correction(spec, read, call)
        with anyio.move_on_after(TRYING_S) as trial:
            mended = await correction.first_that_works(error)
        if trial.cancelled_caught:
            mended = correction.respelt or correction.untested
    if mended is not None:
        return NextCall.again(spec.name, read, mended)
    return _look_up(error, spec, read, call, tools)


@dataclass
class _Correction:
    """The search for a corrected call: corrects faults in sequence, and tries calls if possible.

    ``respelt`` and ``untested``: the first valid call that only corrects names, and the first valid call of a tool
    without a dry run, for the case that there is no time to try it.
    """

    spec: ToolSpec
    read: Mapping[str, Any]
    call: ToolCall
    seen: list[Mapping[str, Any]] = field(default_factory=list)
    respelt: dict[str, Any] | None = None
    untested: dict[str, Any] | None = None

    async def first_that_works(self, error: PlannerForgeError) -> dict[str, Any] | None:
        """Return the arguments of the first corrected call that works, or that is valid if it cannot be tried."""
        self.seen.append(self.read)
        return await self._mended(error, self.read, 0)

    async def _mended(self, error: PlannerForgeError, read: Mapping[str, Any], depth: int) -> dict[str, Any] | None:
        if depth == _MOST_MENDED:
            return None
        for remedy in error.remedies:
            following = None if remedy.tool else followed(remedy, self.spec.name, read)
            if following is None or following.arguments in self.seen:
                continue
            if len(self.seen) > _MOST_TRIED:
                return None
            self.seen.append(following.arguments)
            try:
                arguments = read_arguments(self.spec.arguments_type, following.arguments)
                if remedy.corrects_spelling and depth == 0 and self.respelt is None:
                    self.respelt = _written(arguments)
                if self.spec.trial is None and self.untested is None:
                    self.untested = _written(arguments)
                await self._try(arguments)
            except InvalidRequest as other:
                deeper = await self._mended(other, following.arguments, depth + 1)
                if deeper is not None:
                    return deeper
            except PlannerForgeError:
                continue
            else:
                return _written(arguments)
        return None

    async def _try(self, arguments: Arguments) -> None:
        """Run the call without creating anything, if its tool supports that.

        Raises:
            PlannerForgeError: it is refused, or fails.
        """
        check = self.spec.load_check()
        if self.spec.trial is not None:
            check, arguments = self.spec.load_function(), arguments.model_copy(update=dict(self.spec.trial))
        if check is None or any(getattr(arguments, name) for name in self.spec.making):
            return
        await anyio.lowlevel.checkpoint()
        try:
            await check(arguments, self.call.trial())
        except Exception as raised:
            failure = error_to_report(raised, self.spec.name)
            if isinstance(failure, UnexpectedFailure):
                logger.error("incident %s:\n%s", failure.incident, failure.details)  # noqa: TRY400 - it holds the traceback
            raise failure from raised


def _look_up(
    error: PlannerForgeError, spec: ToolSpec, read: Mapping[str, Any], call: ToolCall, tools: Mapping[str, ToolSpec]
) -> NextCall | None:
    """Return the first valid call that the error suggests or that lists valid values, or None.

    If the call takes over the scenario of the refused call, that scenario must exist.
    """
    named = [remedy for remedy in error.remedies if remedy.tool]
    for remedy in (*named, *_default_remedies(error, spec)):
        following = followed(remedy, spec.name, read)
        if following is None or following.tool not in tools or not tools[following.tool].proposed:
            continue
        if "scenario_id" in remedy.carried and not _is_known(following.arguments.get("scenario_id", "latest"), call):
            continue
        try:
            arguments = read_arguments(tools[following.tool].arguments_type, following.arguments)
        except PlannerForgeError:
            continue
        written = _written(arguments)
        if following.changed is None:
            return replace(following, arguments=written)
        return NextCall.again(following.tool, read, written)
    return None


def _default_remedies(error: PlannerForgeError, spec: ToolSpec) -> tuple[Remedy, ...]:
    """Return the default remedies: an argument's usual path, or the call that lists valid values.

    There is no remedy if the error itself lists all valid values.
    """
    if not isinstance(error, InvalidRequest) or error.complete:
        return ()
    usual = (with_values(**spec.arguments_type.usual_values),) if isinstance(error, OutsideRoots) else ()
    return (*usual, *spec.looks)


def _is_known(scenario_id: object, call: ToolCall) -> bool:
    """Return whether there is a scenario with this id, or any scenario if it is ``latest``."""
    scenario, _, problem = str(scenario_id).partition("#")
    if scenario == "latest":
        return not problem and bool(call.workspace.newest(kind="scenario", limit=1))
    try:
        one_scenario(str(scenario_id), call)
    except PlannerForgeError:
        return False
    return True


def _written(arguments: Arguments) -> dict[str, Any]:
    """Return the arguments in the form of a call."""
    return {name: _as_written(part) for name, part in arguments.model_dump(mode="json", exclude_unset=True).items()}


def _as_written(value: Any) -> Any:
    """Return the same value, with whole numbers written without a decimal part."""
    if isinstance(value, dict):
        return {name: _as_written(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_as_written(part) for part in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value
