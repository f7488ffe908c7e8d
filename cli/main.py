"""The whole command line: the server's commands, its clients in ``agent``, and the evaluation of agents."""

from .clients import application
from .evaluation import corpus, evaluation
from .program import run

application.add_typer(evaluation)
application.add_typer(corpus)


def main() -> None:
    """Run the ``plannerforge`` command."""
    run(application)


if __name__ == "__main__":
    main()
