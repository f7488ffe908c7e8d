"""The whole command line: what the server offers, its clients in ``agent``, and the evaluation of agents."""

from ..agent.command_line import application


def main() -> None:
    """Entry point of the ``plannerforge`` command."""
    application()
