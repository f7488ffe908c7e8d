"""``python -m plannerforge``: the command ``plannerforge`` where no script was installed."""

from .cli.main import main

if __name__ == "__main__":
    main()
