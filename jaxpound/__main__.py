"""``jaxpound`` and ``python -m jaxpound``: the command line, as a process of its own."""

from jaxpound import _interruption as interruption


def main() -> None:
    """Run the command line of this process, and end the process with its exit status.

    A signal ends the process from the first moment to the last: with a line on stderr that says
    what is kept, and the exit status 130 at Ctrl-C and 143 at SIGTERM.
    """
    interruption.end_at_a_signal()  # before the imports, which take longer than all that follows

    from jaxpound.cli.main import main as run

    try:
        status = run()
    except SystemExit as end:  # help, or an example
        status = int(end.code or 0)
    interruption.end(status)


if __name__ == "__main__":
    main()
