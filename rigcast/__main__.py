"""`python -m rigcast`: the command line, by the Python that it shall run in."""

from rigcast.cli import main

if __name__ == "__main__":  # not in the processes that a command starts
    main()
