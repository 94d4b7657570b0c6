"""`python -m msph` is the command `msph`."""

from msph.interrupts import at_once


def main(arguments: list[str] | None = None) -> None:
    """The command line; see msph/cli.py."""
    with at_once():
        from msph.cli import main as run
    run(arguments)


if __name__ == "__main__":
    main()
