"""The errors of PlannerForge.

    PlannerForgeError
    ├── InvalidRequest      the caller asked for something that cannot be meant      (caller corrects the call)
    │   ├── UnknownName     an id, tag, preset, weight … that does not exist
    │   ├── OutsideRoots    a path outside the allowed roots
    │   └── NotPossible     understood, but the scenario, map or network does not allow it
    ├── UnsafeInput         a file that is malformed, hostile or too large
    ├── ResourceFailure     disk, database or memory gave up                         (nothing was lost)
    ├── ServiceFailure      a service on the net did not answer as it should         (nothing was made)
    ├── PlannerFailure      a planner that is not ours broke its contract            (an error of that run alone)
    ├── WorkerFailure       native code in a worker process died
    │   └── WorkerTimeout   … or ran past its limit
    └── UnexpectedFailure   a defect of ours; logged with an incident number         (never shown with a traceback)

Every error carries a stable code, what was wrong, the valid values and the next step, and its text says all of them,
because a host may show the model nothing else.
"""

import errno
import hashlib
import sqlite3
import traceback
from collections.abc import Iterable, Sequence
from itertools import islice
from typing import ClassVar, Self

from ..text import one_line, uncited
from .remedies import NextCall, Place, Remedy, assignments, instead, misspellings


class PlannerForgeError(Exception):
    """Base of all errors that a caller may see.

    Args:
        message: what was wrong, naming the value that was given.
        valid: the values that would be accepted, most useful first (at most twelve are shown).
        next_step: what to call or change next; by default what usually helps (``usual_step`` of the class).
        reason: a stable word for the kind of refusal, for code that decides by it; shown with ``shows_reason`` alone.
        given: the word of the call that is wrong, if one of ``valid`` can stand in its place as it is written there.
        remedies: ways to mend the call, the most useful first; the server writes the first that fits as a call. By
            default they are read from ``valid``: names that a quoted word may misspell (``names_valid``), and fields
            with values, as ``lane=left``.
        complete: whether ``valid`` names all that would be accepted, or its form, so that no call lists more of it.
    """

    code: ClassVar[str] = "error"
    usual_step: ClassVar[str] = "correct what is named and call again"
    shown_values: ClassVar[int] = 12
    tried_values: ClassVar[int] = 3
    """Valid values that are offered in the place of a wrong one, one after the other (chosen)."""
    names_valid: ClassVar[bool] = False
    """Whether ``valid`` holds names that a quoted word may misspell."""
    shows_reason: ClassVar[bool] = False
    longest_message: ClassVar[int] = 2000
    """Characters; chosen: the longest of our own, with a dozen problems, has half as many."""

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
        """Return the same error with further remedies, which come last."""
        self.remedies = (*self.remedies, *remedies)
        return self

    def with_valid(self, *values: str) -> Self:
        """Return the same refusal with further valid values, which come first; its remedies stay."""
        return type(self)(
            self.message,
            valid=[*values, *self.valid],
            next_step=self.next_step,
            reason=self.reason,
            remedies=self.remedies,
            complete=self.complete,
        )

    @property
    def text(self) -> str:
        """The whole error in one line: ``[code] what. Valid: …. Next: ….``"""
        return self.told()

    def told(self, following: NextCall | None = None) -> str:
        """Return the whole error in one line, with the call that mends it if there is one."""
        reason = f" ({self.reason})" if self.shows_reason and self.reason else ""
        parts = [f"[{self.code}] {self.message.rstrip('.')}{reason}."]
        if self.valid:
            shown = ", ".join(self.valid[: self.shown_values])
            more = len(self.valid) - self.shown_values
            parts.append(f"Valid: {shown}{f' and {more} more' if more > 0 else ''}.")
        step = self.next_step.rstrip(".")
        if following is not None:
            step = following.text if step == self.usual_step else f"{following.text}; or {step}"
        return " ".join([*parts, f"Next: {step}."])


class InvalidRequest(PlannerForgeError):
    """The arguments contradict each other or cannot be meant; ``faults``: those that are told together, if several."""

    code = "invalid_request"
    faults: "tuple[InvalidRequest, ...]" = ()


class UnknownName(InvalidRequest):
    """A name or id that does not exist; ``valid`` holds the nearest ones first."""

    code = "unknown_name"
    names_valid = True
    usual_step = "take a name that exists, spelled as it is listed"


class OutsideRoots(InvalidRequest):
    """A path outside the folders that the server may read or write."""

    code = "outside_roots"
    usual_step = "move the file, or name its folder in --roots"


class NotPossible(InvalidRequest):
    """A request that was understood but that the scenario, the map or the network does not allow."""

    code = "not_possible"
    usual_step = "ask for something that is possible there, or elsewhere"


class Faults:
    """What is wrong with a call, collected, so that all of it is told at once and not the first alone."""

    _MOST_VALUES: ClassVar[int] = 5
    _MOST_TOLD: ClassVar[int] = 8

    def __init__(self) -> None:
        self._found: list[InvalidRequest] = []

    def __bool__(self) -> bool:
        return bool(self._found)

    def collecting(self, where: str = "", place: Place = ()) -> "_Collecting":
        """Return a block; if it is refused, the refusal is kept for later.

        Args:
            where: stands before its message.
            place: the part of the arguments that it is about, for its remedies.
        """
        return _Collecting(self._found, where, place)

    def raise_all(self) -> None:
        """Raise what was collected as one error; nothing where nothing was.

        Raises:
            InvalidRequest: of the class and with the reason of the first fault; each with its own valid values.
        """
        if not self._found:
            return
        first = self._found[0]
        if len(self._found) == 1:
            raise first
        told = [self._told(error) for error in self._found[: self._MOST_TOLD]]
        more = len(self._found) - len(told)
        steps = dict.fromkeys(error.next_step for error in self._found[: self._MOST_TOLD])
        together = type(first)(
            f"{len(self._found)} faults: {'; '.join(told)}{f'; and {more} more' if more else ''}",
            next_step="; ".join(steps),
            reason=first.reason,
            remedies=_mending_all(self._found),
            complete=all(fault.complete for fault in self._found),
        )
        together.faults = tuple(self._found)
        raise together from first

    def _told(self, error: "InvalidRequest") -> str:
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
            message = f"{self._where}: {fault.message}" if self._where else fault.message
            kept = type(fault)(
                message,
                valid=fault.valid,
                next_step=fault.next_step,
                reason=fault.reason,
                remedies=[remedy.at(self._place) for remedy in fault.remedies],
                complete=fault.complete,
            )
            kept.__cause__ = error
            if all(other.message != kept.message for other in self._found):
                self._found.append(kept)
        return True


def _mending_all(faults: Sequence[InvalidRequest]) -> list[Remedy]:
    """One remedy for all faults: the first change that each of them names; else the first call that one names."""
    changing = [next((remedy for remedy in fault.remedies if remedy.changes), None) for fault in faults]
    if all(remedy is not None for remedy in changing):
        return [Remedy(tuple(change for remedy in changing if remedy is not None for change in remedy.changes))]
    return [remedy for fault in faults for remedy in fault.remedies if remedy.tool][:1]


class UnsafeInput(PlannerForgeError):
    """A file that is malformed, hostile or larger than the limits."""

    code = "unsafe_input"
    usual_step = "mend the file, or take another; nothing of it was taken in"


class ResourceFailure(PlannerForgeError):
    """Disk, database or memory failed; what was stored before is intact."""

    code = "resource_failure"
    usual_step = "free disk space, or ask for less at once"


class ServiceFailure(PlannerForgeError):
    """A service on the net could not be reached or did not answer as it should; nothing was made of what it sent."""

    code = "service_failure"
    usual_step = "call again later, or import an .osm extract of the place with import_files"


class PlannerFailure(PlannerForgeError):
    """A planner that is not part of this program broke its contract: it crashed, hung, or answered nonsense.

    Its text names the reason, one of those in ``docs/own_planner.md``.
    """

    code = "planner_failure"
    shows_reason = True
    usual_step = "mend the planner; `plannerforge planner check` says what it breaks"


class WorkerFailure(PlannerForgeError):
    """A worker process died while it did the work; the next call gets a fresh one."""

    code = "worker_failure"
    usual_step = "call again: a fresh worker takes over"


class WorkerTimeout(WorkerFailure):
    """A worker process ran past its time limit and was ended."""

    code = "worker_timeout"
    usual_step = "ask for less at once, or raise operation_timeout_s"


class UnexpectedFailure(PlannerForgeError):
    """A defect of ours. The details are logged under an incident number, which is all that a caller sees.

    Args:
        what: the tool or operation that failed.
        details: the traceback, for the log.
    """

    code = "unexpected"

    def __init__(self, what: str, details: str) -> None:
        self.details = details
        self.incident = hashlib.sha256(f"{what}\n{details}".encode()).hexdigest()[:8]
        super().__init__(
            f"{what} failed through a defect of the server (incident {self.incident})",
            next_step="try other arguments, and report the incident with the server's log",
        )


def as_told(raised: Exception, what: str) -> PlannerForgeError:
    """What a caller is told of whatever was raised: the error itself, a failed disk or memory, or a defect of ours.

    Of errors that tasks raised together it is the first that says something to the caller.

    Args:
        what: the tool, job or file that failed, for the incident of a defect.
    """
    leaves = leaves_of(raised)
    for leaf in leaves:
        if isinstance(leaf, PlannerForgeError):
            return leaf
    for leaf in leaves:
        if isinstance(leaf, OSError) and leaf.errno == errno.ENAMETOOLONG:
            return InvalidRequest("a name has more characters than the file system takes", next_step="shorten it")
        if isinstance(leaf, OSError):
            return ResourceFailure(
                f"the operating system refused: {leaf.strerror or leaf}",
                next_step="free disk space or check permissions",
            )
        if isinstance(leaf, sqlite3.OperationalError):
            return ResourceFailure(f"the workspace database cannot be used: {leaf}", next_step="free disk space")
        if isinstance(leaf, RuntimeError) and str(leaf) == _NO_THREAD:
            return ResourceFailure(
                "the operating system starts no more threads for the server: its memory, or the number of its "
                "processes, is at the limit",
                next_step="call again when less is under way, or raise server_memory_mb or the limit of processes",
            )
        if isinstance(leaf, MemoryError):
            return ResourceFailure("the memory of the server was not enough", next_step="ask for less at once")
    return UnexpectedFailure(what, "".join(traceback.format_exception(raised)))


_NO_THREAD = "can't start new thread"
"""What Python says if a thread cannot be started; the error has no class of its own."""


def leaves_of(raised: Exception) -> list[Exception]:
    """Return the errors that a group holds, at any depth; an error that is no group is its own."""
    if isinstance(raised, ExceptionGroup):
        return [leaf for part in raised.exceptions for leaf in leaves_of(part)]
    return [raised]


def error_classes() -> dict[str, type[PlannerForgeError]]:
    """Return all error classes by their code; codes are unique (a test holds it)."""
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
    """Return the error that a worker process reported, made again in the server's process.

    A defect (``unexpected``) takes its message as the details to log; an unknown code gives the base class.
    """
    if code == UnexpectedFailure.code:
        return UnexpectedFailure("an operation", message)
    return error_classes().get(code, PlannerForgeError)(
        message, valid=valid, next_step=next_step, reason=reason, remedies=remedies
    )


_COMPARED = 2000
"""Known words that are compared with one; chosen: with 200 characters each it takes less than a tenth of a second."""


def closest(word: str, known: Iterable[str], limit: int = 12) -> list[str]:
    """Known words ordered by likeness to ``word`` (case and accents ignored), the nearest first.

    At most 200 characters of each of the first 2,000 are compared, so that no name holds up the server.
    """
    from rapidfuzz import fuzz, process, utils

    def compared(text: str) -> str:
        return utils.default_process(one_line(text))

    choices = list(islice(known, _COMPARED))
    scored = process.extract(word, choices, scorer=fuzz.WRatio, processor=compared, limit=limit)
    return [choice for choice, _, _ in scored]
