"""``python -m plannerforge.server``: the same as the ``plannerforge`` command."""

from plannerforge.server.command_line import main

if __name__ == "__main__":
    main()
