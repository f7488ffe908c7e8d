"""``plannerforge test SUITE.yaml``: runs a suite, checks its limits, and writes the results for people and for CI."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import anyio
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn
from rich.table import Column, Table

from ..engine.execution import CallThreads
from ..schemas.analysis.suite import LimitVerdict, Suite, SuiteCase, SuiteReport
from ..schemas.errors import PlannerForgeError, ResourceFailure, leaves_of
from ..schemas.text import counted
from ..server.assembly import open_services
from ..server.observing.logs import log_to_stderr
from ..server.settings import Settings
from ..server.suites import read_suite
from ..workflows.analysis.suite import carry_out

if TYPE_CHECKING:
    from lxml.etree import _Element

HOLDS, BROKEN, NOT_CARRIED_OUT = 0, 1, 2
"""Exit codes: all limits hold; a limit is broken; the suite could not run."""
_SHOWN = 12
"""How many runs that did not reach the goal the terminal and the summary list (chosen)."""


@dataclass(frozen=True)
class SuiteOutputs:
    """Files to write in addition to the printed output; None for a file that is not requested."""

    junit: Path | None = None
    summary: Path | None = None
    report: Path | None = None
    baseline: Path | None = None


def test_suite(path: Path, settings: Settings, outputs: SuiteOutputs) -> int:
    """Run a suite, print and write the results, and return the exit code."""
    errors = Console(stderr=True)
    messages: list[str] = []
    report: SuiteReport | None = None
    try:
        report = anyio.run(_carry_out, read_suite(path), path.resolve().parent, settings, errors)
        _write_all(report, outputs)
    except* PlannerForgeError as failures:
        messages = [str(getattr(error, "text", error)) for error in leaves_of(failures)]
    for text in dict.fromkeys(messages):
        errors.print(text, style="red", highlight=False, markup=False, soft_wrap=True)
    if report is None or messages:
        return NOT_CARRIED_OUT
    print_report(report, Console())
    return HOLDS if report.passed else BROKEN


async def _carry_out(suite: Suite, folder: Path, settings: Settings, console: Console) -> SuiteReport:
    from ..workflows.context import WorkflowContext

    log_to_stderr(settings.log_level, settings.log_format, settings.journal_redact)
    columns = (SpinnerColumn(), BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"))
    threads = CallThreads()
    try:
        async with open_services(settings, folder, threads) as services:
            with Progress(*columns, console=console, transient=True) as bars:
                bar = bars.add_task("starting", total=None)

                def show(done: int, total: int, message: str) -> None:
                    bars.update(bar, completed=done, total=total or None, description=escape(message))

                return await carry_out(suite, folder, WorkflowContext(services), show)
    finally:
        threads.close()


def print_report(report: SuiteReport, console: Console) -> None:
    """Print the limits first, then the runs that did not reach the goal."""
    table = Table(
        "", Column("limit", overflow="fold"), Column("configuration", overflow="fold"), Column("seen", overflow="fold")
    )
    for verdict in report.verdicts:
        mark = "[green]holds[/green]" if verdict.holds else "[red]BROKEN[/red]"
        table.add_row(mark, escape(verdict.limit), escape(verdict.configuration), escape(verdict.observed))
    console.print(table)
    failed = [case for case in report.cases if case.outcome != "goal_reached"]
    for case in failed[:_SHOWN]:
        console.print(f"- {escape(_case_text(case))}", highlight=False, soft_wrap=True)
    if len(failed) > _SHOWN:
        console.print(f"… {len(failed) - _SHOWN} more in {report.batch_id}", highlight=False)
    for progress in report.progress:
        console.print(escape(progress.in_words()), highlight=False, soft_wrap=True)
    for note in report.notes:
        console.print(f"Note: {escape(note)}", highlight=False, soft_wrap=True)
    console.print(_headline(report), highlight=False, soft_wrap=True)


def _headline(report: SuiteReport) -> str:
    broken = sum(not verdict.holds for verdict in report.verdicts)
    text = f"all {counted(len(report.verdicts), 'limit')} hold" if not broken else f"{counted(broken, 'limit')} broken"
    known = f", {report.reused} of them reused" if report.reused else ""
    return f"{report.suite}: {text}; {counted(len(report.cases), 'run')}{known} ({report.batch_id})"


def _case_text(case: SuiteCase) -> str:
    run = f" ({case.run_id})" if case.run_id else ""
    return f"{case.scenario_id} under {case.configuration}{run}: {case.ended}"


def _write_all(report: SuiteReport, outputs: SuiteOutputs) -> None:
    """Write the requested files.

    Raises:
        ResourceFailure: A file cannot be written.
    """
    contents: tuple[tuple[Path | None, Callable[[SuiteReport], bytes]], ...] = (
        (outputs.junit, junit_xml),
        (outputs.summary, lambda made: markdown(made).encode()),
        (outputs.report, lambda made: (made.model_dump_json(indent=1) + os.linesep).encode()),
        (outputs.baseline, lambda made: (made.runs.model_dump_json(indent=1) + os.linesep).encode()),
    )
    for path, content in contents:
        if path is None:
            continue
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content(report))
        except OSError as error:
            raise ResourceFailure(f"{path} cannot be written: {error.strerror}") from error


def junit_xml(report: SuiteReport) -> bytes:
    """Return the report as JUnit XML: one suite of limits, and one of runs per configuration.

    A broken limit is a failure. A run that did not reach its goal is not, since the limits decide; its output says so.
    Runs that could not start are skipped, and lost runs are errors.
    """
    from lxml import etree

    root = etree.Element("testsuites", name=report.suite)
    _add_suite(root, f"{report.suite}: limits", [_limit_case(verdict) for verdict in report.verdicts])
    for name in dict.fromkeys(case.configuration for case in report.cases):
        cases = [_run_case(case) for case in report.cases if case.configuration == name]
        _add_suite(root, f"{report.suite}: {name}", cases)
    return etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=True)


def _add_suite(root: "_Element", name: str, cases: Sequence["_Element"]) -> None:
    from lxml import etree

    counts = {
        f"{kind}s" if kind != "skipped" else kind: str(sum(case.find(kind) is not None for case in cases))
        for kind in ("failure", "error", "skipped")
    }
    suite = etree.SubElement(root, "testsuite", {"name": name, "tests": str(len(cases)), **counts})
    suite.extend(cases)


def _limit_case(verdict: LimitVerdict) -> "_Element":
    from lxml import etree

    case = etree.Element("testcase", name=verdict.limit, classname=f"limits.{verdict.configuration}")
    if verdict.holds:
        etree.SubElement(case, "system-out").text = _printable(verdict.observed)
    else:
        message = f"{verdict.limit}: seen {verdict.observed}"
        etree.SubElement(case, "failure", message=_printable(message), type="limit").text = "\n".join(verdict.run_ids)
    return case


def _run_case(case: SuiteCase) -> "_Element":
    from lxml import etree

    problem = "" if case.problem_id is None else f"#{case.problem_id}"
    element = etree.Element("testcase", name=f"{case.scenario_id}{problem}", classname=f"runs.{case.configuration}")
    if case.outcome == "lost":
        etree.SubElement(element, "error", message=_printable(case.ended), type="lost")
    elif case.outcome == "invalid":
        etree.SubElement(element, "skipped", message=_printable(case.ended))
    else:
        etree.SubElement(element, "system-out").text = _printable(f"{case.ended} ({case.run_id})")
    return element


def _printable(text: str) -> str:
    """Remove characters that XML does not allow."""
    return "".join(letter for letter in text if letter.isprintable() or letter in "\n\t")


def markdown(report: SuiteReport) -> str:
    """Return the report for a CI page: the limits as a table, then the runs that did not reach the goal."""
    lines = [f"## {_headline(report)}", "", "| | limit | configuration | seen |", "| --- | --- | --- | --- |"]
    lines += [
        f"| {'✅' if verdict.holds else '❌'} | `{verdict.limit}` | {_cell(verdict.configuration)} | "
        f"{_cell(verdict.observed)} |"
        for verdict in report.verdicts
    ]
    failed = [case for case in report.cases if case.outcome != "goal_reached"]
    if failed:
        lines += ["", f"{len(failed)} of {counted(len(report.cases), 'run')} did not reach the goal:", ""]
        lines += [f"- {_cell(_case_text(case))}" for case in failed[:_SHOWN]]
        lines += [f"- … {len(failed) - _SHOWN} more"] * (len(failed) > _SHOWN)
    if report.progress:
        lines += ["", *(f"- {_cell(progress.in_words())}" for progress in report.progress)]
    return "\n".join([*lines, ""])


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")
