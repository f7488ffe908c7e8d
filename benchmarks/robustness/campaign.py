"""Sends several hostile inputs at a time, records the effects of each, and repeats suspects alone.

The content of an answer is certain evidence. Effects seen while several inputs ran (a blocked loop, memory, a late
answer, a death, a write outside) only make them suspects. Suspects are sent again alone, to two servers one after the
other, and count if both show the effect.
"""

import re
import shutil
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import anyio
from mcp import MCPError
from mcp.types import CONNECTION_CLOSED

from plannerforge.engine.catalog import unpack
from plannerforge.schemas.errors import PlannerForgeError

from .inputs import Call, HostileInput, filled, keep
from .judges import Canary, Fault, faults_of, journal_faults
from .server_process import Folders, Program, Session, session

SLOW_S, BLOCKED_MS, MEMORY_MB = 5.0, 100.0, 400.0
"""Time limits of a refusal and of a blocked server, and the memory limit of the server's process."""
_LIMIT_S = 60.0
"""Time limit of a call: unfinished work is answered with its job after 50 s at the latest."""
_AT_A_TIME = 4
"""Concurrent inputs (chosen for two cores)."""
_MOST_SUSPECTS = 300
"""Number of suspects to repeat, each cause in turn (chosen)."""
_LOG = "server.log"
_GIVEN_UP = "[given up]"
_ID = re.compile(
    r"\b(?:(?:cfg|run|batch|search|job)_[0-9a-f]{8,}(?:_\d+)?|map_\w+|(?:C-)?[A-Z]{3}_[A-Za-z]\w*-[\w\-]+)"
)


@dataclass(frozen=True)
class Finding:
    """An input that broke a law."""

    hostile: HostileInput
    fault: Fault


@dataclass
class Tally:
    """The observations of a campaign.

    Milliseconds, megabytes and seconds are the largest effects of a single input; ``slowest_s`` is the slowest refusal.
    """

    inputs: int = 0
    calls: int = 0
    answers: Counter[str] = field(default_factory=Counter)
    findings: list[Finding] = field(default_factory=list)
    idle_ping_ms: float = 0.0
    blocked_ms: float = 0.0
    memory_mb: float = 0.0
    slowest_s: float = 0.0
    deaths: list[str] = field(default_factory=list)
    outside_writes: list[str] = field(default_factory=list)
    journal_faults: list[str] = field(default_factory=list)
    left_out: int = 0

    def count(self, law: str) -> int:
        """Return the number of findings that broke a law."""
        return sum(finding.fault.law == law for finding in self.findings)

    @property
    def failures(self) -> int:
        """All failures: laws broken by inputs, and observations of the server, the files around it and its journal."""
        return len(self.findings) + len(self.deaths) + len(self.outside_writes) + len(self.journal_faults)


@dataclass(frozen=True)
class _Answers:
    """The results of one input: certain faults, and the seconds of its slowest refusal."""

    faults: tuple[Fault, ...] = ()
    refused_s: float = 0.0


class Campaign:
    """Sends inputs to servers on copies of a prepared workspace; a refusal is late after ``slow_s``."""

    def __init__(self, template: Folders, base: Path, program: Program, slow_s: float = SLOW_S) -> None:
        self._template, self._base, self._program, self._slow_s = template, base, program, slow_s
        self._servers = 0
        self._suspects: dict[tuple[str, str], list[HostileInput]] = {}
        self.tally = Tally()

    async def carry_out(self, inputs: Iterator[HostileInput], *, keep_in: Path | None = None) -> None:
        """Send all inputs, then suspects alone, and store findings as files if a folder is given."""
        await self.send(_with_progress(inputs))
        self._keep(keep_in)
        await self.replay_suspects()
        self._keep(keep_in)

    def _keep(self, folder: Path | None) -> None:
        if folder is None:
            return
        for number, finding in enumerate(self.tally.findings):
            keep(folder, number, finding.hostile, finding.fault.law, finding.fault.details)

    async def send(self, inputs: Iterator[HostileInput]) -> None:
        """Send all of them, several at a time; a server that dies is replaced."""
        is_over = False
        while not is_over:
            folders = self._fresh()
            async with session(folders, folders.base / _LOG, self._program) as running:
                await anyio.sleep(1.0)
                self.tally.idle_ping_ms = running.idle_ms()
                is_over = await self._send_to(running, folders, inputs)
            self.tally.memory_mb = max(self.tally.memory_mb, running.peak_mb)
            self.tally.journal_faults += journal_faults(folders.workspace)
            shutil.rmtree(folders.base, ignore_errors=True)

    async def _send_to(self, running: Session, folders: Folders, inputs: Iterator[HostileInput]) -> bool:
        """Send until there is no input left (True) or the server is gone (False)."""
        under_way: dict[int, HostileInput] = {}
        canary, is_over = Canary(folders.outside), False

        async def consume(number: int) -> None:
            nonlocal is_over
            while running.is_alive and not is_over:
                hostile = next(inputs, None)
                is_over = hostile is None
                if hostile is None:
                    return
                under_way[number] = hostile
                began, peak = time.monotonic(), running.peak_mb
                self.tally.inputs += 1
                answers = await self._one(running, folders, hostile)
                if await running.has_ended():
                    return
                self._note(hostile, answers)
                self._look(running, tuple(under_way.values()), began, peak, canary)
                del under_way[number]

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(_cancel_when_dead, running, tasks.cancel_scope)
            async with anyio.create_task_group() as consumers:
                for number in range(_AT_A_TIME):
                    consumers.start_soon(consume, number)
            tasks.cancel_scope.cancel()
        if not running.is_alive:
            self.tally.deaths.append(running.death or "the process ended")
            causes = ", ".join(hostile.cause for hostile in under_way.values())
            sys.stderr.write(f"the server is gone: {self.tally.deaths[-1]}; under way: {causes}\n")
            self._suspect(under_way.values(), "death")
        return is_over

    def _note(self, hostile: HostileInput, answers: _Answers) -> None:
        self.tally.findings += [Finding(hostile, fault) for fault in answers.faults]
        if answers.refused_s > self._slow_s:
            self._suspect([hostile], "late")
        else:
            self.tally.slowest_s = max(self.tally.slowest_s, answers.refused_s)

    def _look(
        self, running: Session, under_way: Sequence[HostileInput], began: float, peak_mb: float, canary: Canary
    ) -> None:
        """Return what happened to the server since one of the inputs began."""
        blocked = running.blocked_ms(began) - self.tally.idle_ping_ms
        if blocked > BLOCKED_MS:
            self._suspect(under_way, "blocked")
        else:
            self.tally.blocked_ms = max(self.tally.blocked_ms, blocked)
        if running.peak_mb > max(MEMORY_MB, peak_mb + 20):
            self._suspect(under_way, "memory")
        changes = canary.changes()
        if changes:
            self.tally.outside_writes += changes
            self._suspect(under_way, "outside_write")

    def _suspect(self, hostiles: Iterable[HostileInput], law: str) -> None:
        for hostile in hostiles:
            known = self._suspects.setdefault((law, hostile.cause), [])
            if not any(hostile is other for other in known):
                known.append(hostile)

    async def _one(self, running: Session, folders: Folders, hostile: HostileInput) -> _Answers:
        """Send one input's calls in order; the later ones only if the first created something."""
        faults, refused_s, made, jobs = list[Fault](), 0.0, "", set[str]()
        hostile.place(folders.root, folders.outside)
        try:
            for call in hostile.calls:
                if not made and call is not hostile.calls[0] and call.needs_what_was_made:
                    break
                began = time.monotonic()
                text = await self._answer(running, call, folders, made)
                took = time.monotonic() - began
                self.tally.calls += 1
                self.tally.answers[_code(text)] += 1
                refused_s = max(refused_s, took) if text.startswith("[") else refused_s
                faults += [_explained(fault, call, folders) for fault in faults_of(text)]
                ids = [] if text.startswith("[") else _ID.findall(text)
                made = made or next(iter(ids), "")
                jobs.update(one for one in ids if one.startswith("job_"))
                if text == _GIVEN_UP:
                    jobs.add("latest")
        finally:
            for job in jobs:  # a search of half an hour that was accepted would take the processors from all after it
                ended = Call("cancel_job", {"job_id": job})
                told = await self._answer(running, ended, folders, "")
                faults += [_explained(fault, ended, folders) for fault in faults_of(told)]
            hostile.remove(folders.root)
        return _Answers(tuple(faults), refused_s)

    async def _answer(self, running: Session, call: Call, folders: Folders, made: str) -> str:
        arguments = filled(dict(call.arguments), folders.root, folders.outside, made)
        name = filled(call.name, folders.root, folders.outside, made)
        try:
            with anyio.move_on_after(_LIMIT_S):
                return await _ask(running, Call(name, arguments, call.method))
        except MCPError as error:
            running.is_closed |= error.error.code == CONNECTION_CLOSED
            return f"[protocol {error.error.code}] {error}"
        except (ValueError, TypeError) as error:  # this client cannot write it as JSON, or cannot read the answer
            return f"[client] {str(error)[:200]}"
        except (anyio.ClosedResourceError, anyio.BrokenResourceError, ConnectionError) as error:
            running.is_closed = True
            return f"[gone] {error!r}"
        return _GIVEN_UP

    async def replay_suspects(self) -> None:
        """Send suspects alone, and count those that break the law on two servers."""
        suspects = self._chosen_suspects()
        told = Counter(law for _, laws in suspects for law in laws)
        sys.stderr.write(f"suspects that are sent again alone: {dict(told)}, left out: {self.tally.left_out}\n")
        first = await self.alone([hostile for hostile, _ in suspects])
        again = [
            (hostile, {fault.law: fault for fault in faults if fault.law in laws})
            for (hostile, laws), faults in zip(suspects, first, strict=True)
        ]
        again = [(hostile, seen) for hostile, seen in again if seen]
        second = await self.alone([hostile for hostile, _ in again])
        for (hostile, seen), faults in zip(again, second, strict=True):
            for fault in {fault.law: fault for fault in faults if fault.law in seen}.values():
                self._confirm(hostile, min(fault, seen[fault.law], key=lambda each: each.value))

    def _chosen_suspects(self) -> list[tuple[HostileInput, set[str]]]:
        """Return a limited number of suspects with their suspicion, taking each cause in turn."""
        ranked = [
            (place, law, hostile)
            for (law, _), suspects in sorted(self._suspects.items())
            for place, hostile in enumerate(suspects)
        ]
        ranked.sort(key=lambda each: each[0])
        chosen: dict[int, tuple[HostileInput, set[str]]] = {}
        for _, law, hostile in ranked:
            if id(hostile) in chosen or len(chosen) < _MOST_SUSPECTS:
                chosen.setdefault(id(hostile), (hostile, set()))[1].add(law)
            else:
                self.tally.left_out += 1
        return list(chosen.values())

    def _confirm(self, hostile: HostileInput, fault: Fault) -> None:
        self.tally.findings.append(Finding(hostile, fault))
        if fault.law == "blocked":
            self.tally.blocked_ms = max(self.tally.blocked_ms, fault.value)
        if fault.law == "late":
            self.tally.slowest_s = max(self.tally.slowest_s, fault.value)

    async def alone(self, hostiles: Sequence[HostileInput]) -> list[list[Fault]]:
        """Send inputs one after the other and return the laws that each broke. A dead server is replaced."""
        waiting, faults = list(reversed(hostiles)), list[list[Fault]]()
        while waiting:
            folders = self._fresh()
            async with session(folders, folders.base / _LOG, self._program) as running:
                await anyio.sleep(1.0)
                idle_ms = running.idle_ms()
                while waiting and running.is_alive:
                    faults.append(await self._alone(running, folders, waiting.pop(), idle_ms))
            shutil.rmtree(folders.base, ignore_errors=True)
        return faults

    async def _alone(self, running: Session, folders: Folders, hostile: HostileInput, idle_ms: float) -> list[Fault]:
        canary, answers, began = Canary(folders.outside), _Answers(), time.monotonic()
        running.forget_peak()
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(_cancel_when_dead, running, tasks.cancel_scope)
            answers = await self._one(running, folders, hostile)
            if not await running.has_ended():
                await anyio.sleep(0.1)  # a ping that waited is answered too
            tasks.cancel_scope.cancel()
        blocked, changes = running.blocked_ms(began) - idle_ms, canary.changes()
        faults = list(answers.faults)
        if not running.is_alive:
            faults.append(Fault("death", running.death or "the process ended"))
        if blocked > BLOCKED_MS:
            faults.append(Fault("blocked", f"{blocked:,.0f} ms", blocked))
        if answers.refused_s > self._slow_s:
            faults.append(Fault("late", f"{answers.refused_s:.1f} s", answers.refused_s))
        if running.peak_mb > MEMORY_MB:
            faults.append(Fault("memory", f"{running.peak_mb:,.0f} MB", running.peak_mb))
        if changes:
            faults.append(Fault("outside_write", "; ".join(changes)))
        return faults

    def _fresh(self) -> Folders:
        self._servers += 1
        return Folders(self._base / f"server{self._servers}").make(self._template)


def _with_progress(inputs: Iterator[HostileInput]) -> Iterator[HostileInput]:
    began = time.monotonic()
    for number, hostile in enumerate(inputs):
        if number % 500 == 0 and number:
            sys.stderr.write(f"{number} inputs, {number / (time.monotonic() - began):.0f} a second\n")
        yield hostile


async def _cancel_when_dead(running: Session, scope: anyio.CancelScope) -> None:
    """Cancel waiting calls when the server is dead."""
    while running.is_alive:
        await anyio.sleep(0.1)
    scope.cancel()


async def _ask(running: Session, call: Call) -> str:
    """Return the text of an answer, as a model reads it."""
    if call.method == "archive":
        return await anyio.to_thread.run_sync(_unpacked, Path(call.name))
    if call.method == "resource":
        read = await running.client.read_resource(call.name)
        return "\n".join(getattr(content, "text", "") for content in read.contents)
    if call.method == "prompt":
        prompt = await running.client.get_prompt(call.name, dict(call.arguments))
        return "\n".join(getattr(message.content, "text", "") for message in prompt.messages)
    result = await running.client.call_tool(call.name, dict(call.arguments))
    return "\n".join(getattr(block, "text", "") for block in result.content)


def _unpacked(path: Path) -> str:
    """Return the command line's output for an archive; anything but a refusal of ours is a defect."""
    try:
        with unpack(path) as folder:
            return f"{sum(1 for _ in folder.iterdir())} files"
    except PlannerForgeError as error:
        return error.text
    except Exception as error:  # noqa: BLE001 - the bench is here to see it
        return f"[unexpected] {type(error).__name__}: {error}"


def _code(text: str) -> str:
    match = re.match(r"\[([a-z_ \-\d]+)\]", text)
    return match[1] if match else "answered"


def _explained(fault: Fault, call: Call, folders: Folders) -> Fault:
    """Return a fault with its call and, for an incident, the log's last place in the package and the exception."""
    said = f"{call.name[:60]}: {fault.details}"
    incident = re.search(r"\(incident (\w+)\)", fault.details)
    if incident is not None:
        log = (folders.base / _LOG).read_text(errors="replace")
        trace = log.partition(f"incident {incident[1]}:")[2].partition("\nincident ")[0].strip()
        places = re.findall(
            r'File "[^"]*/((?:engine|tools|server|schemas|resources|prompts)/[^"]+)", line (\d+)', trace
        )
        errors = [line.strip(" |") for line in trace.splitlines() if re.match(r"[\s|]*[A-Za-z_.]+: ", line)]
        if places and errors:
            said = f"{call.name[:60]}: {':'.join(places[-1])}: {errors[-1][:200]}"
    return replace(fault, details=said)
