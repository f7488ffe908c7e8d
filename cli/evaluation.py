"""``plannerforge eval`` and ``plannerforge corpus``: measure an agent on requests whose answers are known."""

from pathlib import Path
from typing import Annotated

import typer

from .flags import Workspace, settings_from

evaluation = typer.Typer(name="eval", no_args_is_help=True, help="Measure agents on requests whose answers are known.")
corpus = typer.Typer(name="corpus", no_args_is_help=True, help="Requests with ground truth, made from what is at hand.")

Agent = Annotated[str, typer.Option(help="ollama:MODEL, openai:MODEL@URL, or one without a model such as oracle.")]
ConditionName = Annotated[
    str, typer.Option("--condition", help="The paper's prompt: baseline, cp, cp_cot, cp_icl or cp_icl_cot.")
]
Corpus = Annotated[Path | None, typer.Option(help="A corpus file or a folder of them; default: the package's own.")]
Out = Annotated[
    Path | None, typer.Option(help="Folder of rows, tables and report; default: evaluations/AGENT-CONDITION.")
]
Limit = Annotated[int | None, typer.Option(min=1, help="Only the first requests of each corpus.")]
AtOnce = Annotated[int, typer.Option("--workers", min=1, max=64, help="Requests at a time, each with a server.")]
Seed = Annotated[int, typer.Option(help="For what an agent, or the making of a corpus, draws.")]
Scenarios = Annotated[
    Path | None, typer.Option(help="Folder of the CommonRoad files of the corpus; default: the starter catalogue.")
]
Maps = Annotated[Path | None, typer.Option(help="Folder of the maps of the corpus; default: the built-in maps.")]
Base = Annotated[
    Path | None,
    typer.Option("--workspace", help="Workspace that the server works on a copy of, as `corpus make` read it."),
]
Conversations = Annotated[
    int | None, typer.Option("--conversations", min=1, help="e2e: make as many conversations instead of reading any.")
]
TASK_NAMES = ("generation", "selection", "modification", "routing", "tuning", "e2e", "all")


def _add_task(task: str) -> None:
    """The command of a task; all of them have the same options."""

    def run(
        agent: Agent = "oracle",
        condition: ConditionName = "cp_icl_cot",
        corpus: Corpus = None,
        out: Out = None,
        limit: Limit = None,
        workers: AtOnce = 1,
        seed: Seed = 0,
        scenarios: Scenarios = None,
        maps: Maps = None,
        workspace: Base = None,
        conversations: Conversations = None,
    ) -> None:
        from ..evals.running import EvaluationOrder, run_evaluation

        order = EvaluationOrder(
            task=task,
            agent=agent,
            condition=condition,
            corpus=corpus,
            out=out,
            limit=limit,
            workers=workers,
            seed=seed,
            scenarios=scenarios,
            maps=maps,
            workspace=workspace,
            conversations=conversations,
        )
        raise typer.Exit(run_evaluation(order))

    what = "conversations, stage by stage" if task == "e2e" else "requests of all tasks" if task == "all" else task
    evaluation.command(task, help=f"Evaluate an agent on {what}; broken off, the same command goes on.")(run)


for _task in TASK_NAMES:
    _add_task(_task)


@evaluation.command()
def compare(
    first: Annotated[Path, typer.Argument(help="Folder of an evaluation, or a file of rows.")],
    second: Annotated[Path, typer.Argument(help="Another one of the same requests.")],
) -> None:
    """Compare two evaluations request by request: shares, an exact test, what was gained and lost."""
    from ..evals.running import print_comparison

    raise typer.Exit(print_comparison(first, second))


@evaluation.command()
def report(folder: Annotated[Path, typer.Argument(help="Folder of an evaluation.", exists=True)]) -> None:
    """Print the tables of an evaluation, and write them and the report anew."""
    from ..evals.running import print_results

    raise typer.Exit(print_results(folder))


@evaluation.command()
def requests(
    task: Annotated[str, typer.Argument(help=f"One of {', '.join(TASK_NAMES)}.")],
    corpus: Corpus = None,
    limit: Limit = None,
    marks: Annotated[
        Path | None, typer.Option(help="Ask one after the other, and note in this file when each begins and ends.")
    ] = None,
) -> None:
    """Print what to ask another MCP client, without the answers.

    With --marks each request waits for Enter; --agent journal:JOURNAL@MARKS scores the calls made between them.
    """
    from ..evals.running import print_requests

    raise typer.Exit(print_requests(task, corpus, limit=limit, marks=marks))


@corpus.command()
def make(
    out: Annotated[Path, typer.Option(help="Folder of the corpora.")],
    workspace: Workspace = None,
    task: Annotated[list[str] | None, typer.Option(help="A task; repeatable. Default: all.")] = None,
    count: Annotated[int, typer.Option(min=1, max=10_000, help="Requests of each corpus, at most.")] = 24,
    seed: Seed = 1,
    whole: Annotated[bool, typer.Option("--whole", help="Do not split by scenario into dev and test.")] = False,
) -> None:
    """Make requests with ground truth from the scenarios and maps of a workspace."""
    from ..evals.running import make_own_corpora

    folder = settings_from(workspace=workspace).workspace.expanduser().resolve()
    raise typer.Exit(make_own_corpora(folder, out, tasks=task or [], count=count, seed=seed, whole=whole))
