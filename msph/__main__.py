"""`python -m msph` is the command `msph`."""

from msph.interrupts import importing


def main(arguments: list[str] | None = None) -> None:
    """The command line; see msph/cli.py."""
    with importing():
        from msph.cli import main as run
    run(arguments)


if __name__ == "__main__":
    main()
