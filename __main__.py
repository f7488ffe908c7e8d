"""``python -m plannerforge``: the command ``plannerforge`` where no script was installed."""

from .evals.command_line import main

if __name__ == "__main__":
    main()
