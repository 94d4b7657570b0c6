"""`python main.py` opens the pool: it is `msph play`, or any other msph command."""

import sys

from msph.interrupts import importing

with importing():
    from msph.cli import cli, main

if __name__ == "__main__":
    known = {*cli.commands, "-h", "--help", "--version"}
    main(sys.argv[1:] if sys.argv[1:2] and sys.argv[1] in known else ["play", *sys.argv[1:]])
