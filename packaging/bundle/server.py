"""What a host starts: the command ``plannerforge`` of the wheel beside this file."""

from plannerforge.evals.command_line import main

if __name__ == "__main__":
    main()
