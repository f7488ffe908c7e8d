"""``python -m plannerforge.server``: ``serve``, ``call`` and ``tools`` without the installed command."""

from .command_line import application, run

if __name__ == "__main__":
    run(application)
