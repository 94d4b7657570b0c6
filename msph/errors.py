"""Errors that a user is told of in one line."""

import difflib
from collections.abc import Iterable

# Least likeness (-) of a name to a known one that is taken as meant: half of the letters of both
# are alike and in order.
LIKENESS = 0.5


class MsphError(Exception):
    """A run that went wrong. str() is one line fit to be shown to a person."""

    EXIT_CODE = 1

    def __str__(self) -> str:
        # Names of files and keys may hold any character.
        return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in super().__str__())


class BadInputError(MsphError):
    """Input that cannot be used."""

    EXIT_CODE = 2


class LostOutputError(MsphError):
    """An output that could not be written to its end."""


class BlowUpError(MsphError):
    """Water that is not finite any more, or has collapsed."""

    def __init__(self, what: str):
        super().__init__(f"the water blew up: {what}")


def did_you_mean(name: str, known: Iterable[str], kind: str = "known") -> str:
    """What to write in place of a name that is not known: the nearest of those that are, or all,
    under the word that says what they are."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=LIKENESS)
    return f"did you mean {near[0]!r}?" if near else f"{kind}: {', '.join(names) or 'none'}"
