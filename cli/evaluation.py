"""``plannerforge eval`` and ``plannerforge corpus``: evaluates agents on requests with known answers."""

from pathlib import Path
from typing import Annotated

import typer

from .flags import Workspace, settings_from

evaluation = typer.Typer(name="eval", no_args_is_help=True, help="Evaluate agents on requests with known answers.")
corpus = typer.Typer(
    name="corpus", no_args_is_help=True, help="Create requests with ground truth from your scenarios and maps."
)

Agent = Annotated[
    str, typer.Option(help="ollama:MODEL, openai:MODEL@URL, or an agent without a model, such as oracle.")
]
ConditionName = Annotated[
    str, typer.Option("--condition", help="The paper's prompt: baseline, cp, cp_cot, cp_icl or cp_icl_cot.")
]
Corpus = Annotated[Path | None, typer.Option(help="A corpus file, or a folder of them; default: the packaged corpora.")]
Out = Annotated[
    Path | None, typer.Option(help="Folder for rows, tables and report; default: evaluations/AGENT-CONDITION.")
]
Limit = Annotated[int | None, typer.Option(min=1, help="Only the first requests of each corpus.")]
AtOnce = Annotated[int, typer.Option("--workers", min=1, max=64, help="Parallel requests, each with its own server.")]
Seed = Annotated[int, typer.Option(help="Seed for the agent, or for creating a corpus.")]
Scenarios = Annotated[
    Path | None, typer.Option(help="Folder with the corpus's CommonRoad files; default: the starter catalogue.")
]
Maps = Annotated[Path | None, typer.Option(help="Folder with the corpus's maps; default: the built-in maps.")]
Base = Annotated[
    Path | None,
    typer.Option("--workspace", help="The workspace that `corpus make` read; the server uses a copy of it."),
]
Conversations = Annotated[
    int | None,
    typer.Option("--conversations", min=1, help="e2e: create this many conversations instead of reading them."),
]
TASK_NAMES = ("generation", "selection", "modification", "routing", "tuning", "e2e", "all")


def _add_task(task: str) -> None:
    """Add the command of a task; all tasks have the same options."""

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
    evaluation.command(task, help=f"Evaluate an agent on {what}; after an interruption, the same command continues.")(
        run
    )


for _task in TASK_NAMES:
    _add_task(_task)


@evaluation.command()
def compare(
    first: Annotated[Path, typer.Argument(help="Folder of an evaluation, or a file of rows.")],
    second: Annotated[Path, typer.Argument(help="Another evaluation of the same requests.")],
) -> None:
    """Compare two evaluations request by request: shares, an exact test, gains and losses."""
    from ..evals.running import print_comparison

    raise typer.Exit(print_comparison(first, second))


@evaluation.command()
def report(folder: Annotated[Path, typer.Argument(help="Folder of an evaluation.", exists=True)]) -> None:
    """Print the tables of an evaluation, and rewrite them and the report."""
    from ..evals.running import print_results

    raise typer.Exit(print_results(folder))


@evaluation.command()
def requests(
    task: Annotated[str, typer.Argument(help=f"One of {', '.join(TASK_NAMES)}.")],
    corpus: Corpus = None,
    limit: Limit = None,
    marks: Annotated[
        Path | None, typer.Option(help="Pose requests in turn, and record in this file when each starts and ends.")
    ] = None,
) -> None:
    """Print the requests for another MCP client, without the answers.

    With --marks, each request waits for Enter; --agent journal:JOURNAL@MARKS then scores the calls between the marks.
    """
    from ..evals.running import print_requests

    raise typer.Exit(print_requests(task, corpus, limit=limit, marks=marks))


@corpus.command()
def make(
    out: Annotated[Path, typer.Option(help="Folder for the corpora.")],
    workspace: Workspace = None,
    task: Annotated[list[str] | None, typer.Option(help="A task; repeatable. Default: all.")] = None,
    count: Annotated[int, typer.Option(min=1, max=10_000, help="Most requests per corpus.")] = 24,
    seed: Seed = 1,
    whole: Annotated[bool, typer.Option("--whole", help="Do not split by scenario into dev and test.")] = False,
) -> None:
    """Create requests with ground truth from the scenarios and maps of a workspace."""
    from ..evals.running import make_own_corpora

    folder = settings_from(workspace=workspace).workspace.expanduser().resolve()
    raise typer.Exit(make_own_corpora(folder, out, tasks=task or [], count=count, seed=seed, whole=whole))
