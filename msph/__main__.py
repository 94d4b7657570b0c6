"""Entry point of `python -m msph` and of the command `msph`."""

from msph.interrupts import importing


def main(arguments: list[str] | None = None) -> None:
    """Runs the command line (msph/cli.py)."""
    with importing():
        from msph.cli import main as run
    run(arguments)


if __name__ == "__main__":
    main()
