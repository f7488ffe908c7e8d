"""What a host starts: the command ``plannerforge`` of the wheel beside this file."""

from plannerforge.cli.main import main

if __name__ == "__main__":
    main()
