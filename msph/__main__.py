"""`python -m msph` is the command `msph`."""

from msph.cli import main

if __name__ == "__main__":
    main()
