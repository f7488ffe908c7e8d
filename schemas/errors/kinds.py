"""The errors of PlannerForge.

    PlannerForgeError
    ├── InvalidRequest      the request is invalid                                   (caller corrects the call)
    │   ├── UnknownName     an id, tag, preset, weight … that does not exist
    │   ├── OutsideRoots    a path outside the allowed roots
    │   └── NotPossible     valid, but the scenario, map or network does not allow it
    ├── UnsafeInput         a file that is malformed, hostile or too large
    ├── ResourceFailure     disk, database or memory failed                          (nothing was lost)
    ├── ServiceFailure      an online service did not answer as it should            (nothing was created)
    ├── PlannerFailure      an external planner broke its contract                   (an error of that run alone)
    ├── WorkerFailure       native code in a worker process died
    │   └── WorkerTimeout   … or exceeded its time limit
    └── UnexpectedFailure   an internal defect, logged with an incident number       (never shown with a traceback)

Every error has a stable code, what was wrong, the valid values, and the next step. Its text states all of them, because
a host may show the model nothing else.
"""

import errno
import hashlib
import sqlite3
import traceback
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar, Self

from ..text import one_line, uncited
from .likeness import misspelt_names
from .remedies import NextCall, Place, Remedy, assignments, instead, misspellings, misspelt


class PlannerForgeError(Exception):
    """The base of all errors that a caller may see.

    Args:
        message: what was wrong, with the given value.
        valid: the values that would be accepted, most useful first (at most twelve are shown).
        next_step: what to call or change next; by default the usual remedy (``usual_step`` of the class).
        reason: a stable word for the kind of refusal, for code that depends on it; shown only with ``shows_reason``.
        given: the wrong word in the call, if one of ``valid`` can replace it as written.
        remedies: ways to correct the call, the most useful first; the server writes the first applicable one as a call.
            By default they come from ``valid``: names that a quoted word may misspell (``names_valid``), and fields
            with values, as in ``lane=left``.
        complete: whether ``valid`` lists all valid values, or states their form, so that no call can list more.
    """

    code: ClassVar[str] = "error"
    usual_step: ClassVar[str] = "correct the call and repeat it"
    shown_values: ClassVar[int] = 12
    tried_values: ClassVar[int] = 3
    """How many valid values are offered as replacements of a wrong one (chosen)."""
    names_valid: ClassVar[bool] = False
    """Whether ``valid`` contains names that a quoted word may misspell."""
    shows_reason: ClassVar[bool] = False
    longest_message: ClassVar[int] = 2000
    """The maximum length in characters (chosen: our longest message, with a dozen problems, is half as long)."""

    def __init__(
        self,
        message: str,
        *,
        valid: Iterable[object] = (),
        next_step: str = "",
        reason: str = "",
        given: str = "",
        remedies: Iterable[Remedy] | None = None,
        complete: bool = False,
    ) -> None:
        self.message, self.reason = one_line(message, self.longest_message), reason
        self.complete = complete
        self.valid: tuple[str, ...] = tuple(one_line(str(value)) for value in valid)
        bare = tuple(map(uncited, self.valid))
        replacing = [instead(given, value) for value in bare[: self.tried_values]] if given else []
        if remedies is None:
            if self.names_valid and not given:
                replacing = misspellings(self.message, bare)[: self.tried_values]
            remedies = assignments(bare)
        self.remedies: tuple[Remedy, ...] = (*replacing, *remedies)
        self.next_step = next_step or self.usual_step
        super().__init__(self.text)

    def also(self, *remedies: Remedy) -> Self:
        """Return the same error with further remedies at the end."""
        self.remedies = (*self.remedies, *remedies)
        return self

    def with_valid(self, *values: str) -> Self:
        """Return the same refusal with further valid values at the front. Its remedies stay."""
        return self._copy(valid=[*values, *self.valid])

    def with_message(self, message: str) -> Self:
        """Return the same refusal with another message. Its remedies stay."""
        return self._copy(message=message)

    def with_only(self, values: Iterable[str], *, complete: bool) -> Self:
        """Return the same refusal with other valid values. Its remedies stay."""
        return self._copy(valid=values, complete=complete)

    def with_words(self, word: str, words: Iterable[str]) -> Self:
        """Return the same refusal with the words, such as ``latest``, that the given one may misspell, at the front."""
        known = list(words)
        refusal = self.with_valid(*misspelt_names(word, known))
        refusal.remedies = (*misspelt(word, known), *self.remedies)
        return refusal

    def preceded_by(self, text: str, place: Place = ()) -> Self:
        """Return the same refusal with a text before its message; ``place``: where its remedies then apply."""
        return self._copy(message=f"{text}{self.message}", remedies=[remedy.at(place) for remedy in self.remedies])

    def _copy(self, **changed: Any) -> Self:
        names = ("message", "valid", "next_step", "reason", "remedies", "complete")
        return type(self)(**{name: changed.get(name, getattr(self, name)) for name in names})

    @property
    def text(self) -> str:
        """The whole error in one line: ``[code] what. Valid: …. Next: ….``"""
        return self.text_with()

    def text_with(self, following: NextCall | None = None) -> str:
        """Return the whole error in one line, with the call that corrects the request if there is one."""
        reason = f" ({self.reason})" if self.shows_reason and self.reason else ""
        parts = [f"[{self.code}] {self.message.rstrip('.')}{reason}."]
        if self.valid:
            rest = len(self.valid) - self.shown_values
            shown = ", ".join(self.valid if rest == 1 else self.valid[: self.shown_values])
            more = 0 if rest == 1 else rest
            parts.append(f"Valid: {shown}{f' and {more} more' if more > 0 else ''}.")
        return " ".join([*parts, f"Next: {self._steps(following)}."])

    def _steps(self, following: NextCall | None) -> str:
        """Return the next step of the error, the proposed call, or both, the one that fits the cause better first.

        A call that lists valid values fits a name that does not exist, but neither a wrong unit or path nor names that
        are listed here. A call without the wrong argument gives up what was requested, so it comes last. A corrected
        call says what an own step without another call would say.
        """
        own = self.next_step.rstrip(".")
        if following is None:
            return own
        is_usual = own == self.usual_step
        if following.only_drops:
            return following.text if is_usual and not isinstance(self, UnknownName) else f"{own}; or {following.text}"
        if following.changed is not None:
            adds = not is_usual and (isinstance(self, NotPossible) or "call " in own)
            return f"{following.text}; or {own}" if adds else following.text
        if f"call {following.tool}" in own or not (is_usual or self._needs_list(following)):
            return own
        is_listed = is_usual and self.valid and not self._needs_list(following)
        return own if is_listed else following.text if is_usual else f"{following.text}; or {own}"

    def _needs_list(self, following: NextCall) -> bool:
        """Return whether a call helps that lists valid values: the error names it, or does not list all names."""
        if any(remedy.tool == following.tool for remedy in self.remedies):
            return True
        if isinstance(self, UnknownName):
            return not 0 < len(self.valid) < self.shown_values
        return isinstance(self, NotPossible) and "scenario_id" in following.arguments


class InvalidRequest(PlannerForgeError):
    """The arguments are invalid or contradict each other; ``faults`` lists them if there are several."""

    code = "invalid_request"
    faults: "tuple[InvalidRequest, ...]" = ()


class UnknownName(InvalidRequest):
    """A name or id that does not exist; ``valid`` lists the nearest names first."""

    code = "unknown_name"
    names_valid = True
    usual_step = "use one of the names listed"


class OutsideRoots(InvalidRequest):
    """A path outside the folders that the server may read or write."""

    code = "outside_roots"
    usual_step = "move the file, or add its folder to --roots"


class NotPossible(InvalidRequest):
    """A valid request that the scenario, the map or the network does not allow."""

    code = "not_possible"
    usual_step = "request something that is possible there, or choose another scenario or map"


class Faults:
    """The faults of a call, collected so that one error reports them all."""

    _MOST_VALUES: ClassVar[int] = 5
    _MOST_LISTED: ClassVar[int] = 8

    def __init__(self) -> None:
        self._found: list[InvalidRequest] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def collecting(self, where: str = "", place: Place = ()) -> "_Collecting":
        """Return a context that keeps a refusal for later.

        Args:
            where: a prefix of its message.
            place: the part of the arguments that it refers to, for its remedies.
        """
        return _Collecting(self._found, where, place)

    def raise_all(self) -> None:
        """Raise the collected faults as one error, if there are any.

        Raises:
            InvalidRequest: there are faults; the error has the class and reason of the first fault, and the valid
                values of all.
        """
        if not self._found:
            return
        first = self._found[0]
        if len(self._found) == 1:
            raise first
        shown = [self._fault_text(error) for error in self._found[: self._MOST_LISTED]]
        more = len(self._found) - len(shown)
        steps = list(dict.fromkeys(error.next_step for error in self._found))
        together = type(first)(
            f"{len(self._found)} errors: {'; '.join(shown)}{f'; and {more} more' if more else ''}",
            next_step=steps[0] if len(steps) == 1 else "correct each of these",
            reason=first.reason,
            remedies=_common_remedies(self._found),
            complete=all(fault.complete for fault in self._found),
        )
        together.faults = tuple(self._found)
        raise together from first

    def _fault_text(self, error: "InvalidRequest") -> str:
        more = len(error.valid) - self._MOST_VALUES
        rest = f" and {more} more" if more > 0 else ""
        valid = f" (valid: {', '.join(error.valid[: self._MOST_VALUES])}{rest})" if error.valid else ""
        return f"{error.message.rstrip('.')}{valid}"


class _Collecting:
    def __init__(self, found: list[InvalidRequest], where: str, place: Place) -> None:
        self._found, self._where, self._place = found, where, place

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: object) -> bool:
        if not isinstance(error, InvalidRequest):
            return False
        for fault in error.faults or (error,):
            kept = fault.preceded_by(f"{self._where}: " if self._where else "", self._place)
            kept.__cause__ = error
            if all(other.message != kept.message for other in self._found):
                self._found.append(kept)
        return True


def _common_remedies(faults: Sequence[InvalidRequest]) -> list[Remedy]:
    """Return one remedy for all faults: the first change from each fault, otherwise the first call."""
    changing = [next((remedy for remedy in fault.remedies if remedy.changes), None) for fault in faults]
    if all(remedy is not None for remedy in changing):
        return [Remedy(tuple(change for remedy in changing if remedy is not None for change in remedy.changes))]
    return [remedy for fault in faults for remedy in fault.remedies if remedy.tool][:1]


class UnsafeInput(PlannerForgeError):
    """A file that is malformed, hostile or larger than the limits."""

    code = "unsafe_input"
    usual_step = "correct the file or use another one; this one was not imported"


class ResourceFailure(PlannerForgeError):
    """Disk, database or memory failed. What was stored before is intact."""

    code = "resource_failure"
    usual_step = "free disk space, or request less at once"


class ServiceFailure(PlannerForgeError):
    """An online service could not be reached or gave an invalid answer. Nothing was created from it."""

    code = "service_failure"
    usual_step = "call again later, or import an .osm extract of the place with import_files"


class PlannerFailure(PlannerForgeError):
    """An external planner broke its contract: it crashed, hung, or gave an invalid answer.

    Its text contains the reason, one of those in ``docs/own_planner.md``.
    """

    code = "planner_failure"
    shows_reason = True
    usual_step = "correct the planner; `plannerforge planner check` reports what is wrong"


class WorkerFailure(PlannerForgeError):
    """A worker process died during the work. The next call gets a new process."""

    code = "worker_failure"
    usual_step = "call again: a new worker takes over"


class WorkerTimeout(WorkerFailure):
    """A worker process exceeded its time limit and was stopped."""

    code = "worker_timeout"
    usual_step = "request less at once, or raise operation_timeout_s"


class UnexpectedFailure(PlannerForgeError):
    """An internal defect. Its details are logged under an incident number, and the caller sees only that.

    Args:
        what: the tool or operation that failed.
        details: the traceback, for the log.
    """

    code = "unexpected"

    def __init__(self, what: str, details: str) -> None:
        self.details = details
        self.incident = hashlib.sha256(f"{what}\n{details}".encode()).hexdigest()[:8]
        super().__init__(
            f"{what} failed because of a bug in the server (incident {self.incident})",
            next_step="try other arguments, and report the incident with the server's log",
        )


def error_to_report(raised: Exception, what: str) -> PlannerForgeError:
    """Return the error to report for an exception: the exception itself, a disk or memory failure, or a defect.

    From errors that tasks raised together, return the first that helps the caller.

    Args:
        what: the tool, job or file that failed; recorded in the incident if it is a defect.
    """
    leaves = leaves_of(raised)
    for leaf in leaves:
        if isinstance(leaf, PlannerForgeError):
            return leaf
    for leaf in leaves:
        if isinstance(leaf, OSError) and leaf.errno == errno.ENAMETOOLONG:
            return InvalidRequest("a name is longer than the file system allows", next_step="shorten it")
        if isinstance(leaf, OSError):
            return ResourceFailure(
                f"the operating system refused: {leaf.strerror or leaf}",
                next_step="free disk space or check permissions",
            )
        if isinstance(leaf, sqlite3.OperationalError):
            return ResourceFailure(f"the workspace database cannot be used: {leaf}", next_step="free disk space")
        if isinstance(leaf, RuntimeError) and str(leaf) == _NO_THREAD:
            return ResourceFailure(
                "the operating system does not start more threads for the server: its memory or its number of "
                "processes is at the limit",
                next_step="call again when less is running, or raise server_memory_mb or the limit of processes",
            )
        if isinstance(leaf, MemoryError):
            return ResourceFailure("the server ran out of memory", next_step="request less at once")
    return UnexpectedFailure(what, "".join(traceback.format_exception(raised)))


_NO_THREAD = "can't start new thread"
"""Python's message if a thread cannot be started; the error has no class of its own."""


def leaves_of(raised: Exception) -> list[Exception]:
    """Return the errors in a group, at any depth, or the error itself."""
    if isinstance(raised, ExceptionGroup):
        return [leaf for part in raised.exceptions for leaf in leaves_of(part)]
    return [raised]


def error_classes() -> dict[str, type[PlannerForgeError]]:
    """Return all error classes by code; codes are unique (a test checks it)."""
    by_code: dict[str, type[PlannerForgeError]] = {}
    waiting: list[type[PlannerForgeError]] = [PlannerForgeError]
    while waiting:
        current = waiting.pop()
        by_code[current.code] = current
        waiting.extend(current.__subclasses__())
    return by_code


def rebuild(
    code: str, message: str, valid: Sequence[str], next_step: str, reason: str = "", remedies: Sequence[Remedy] = ()
) -> PlannerForgeError:
    """Return the error that a worker process reported, recreated in the server's process.

    A defect (``unexpected``) gets its message as the details to log. An unknown code gives the base class.
    """
    if code == UnexpectedFailure.code:
        return UnexpectedFailure("an operation", message)
    return error_classes().get(code, PlannerForgeError)(
        message, valid=valid, next_step=next_step, reason=reason, remedies=remedies
    )
