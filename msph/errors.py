"""Errors that are reported to the user in one line."""

import difflib
from collections.abc import Iterable

# Similarity (-) from which a known name is suggested for an unknown one (difflib's ratio).
MIN_SIMILARITY = 0.5


class MsphError(Exception):
    """Error of a run. str() is one line fit for display."""

    EXIT_CODE = 1

    def __str__(self) -> str:
        # File names and keys may hold any character.
        return "".join(c if c.isprintable() else ascii(c)[1:-1] for c in super().__str__())


class BadInputError(MsphError):
    """Input that cannot be used."""

    EXIT_CODE = 2


class LostOutputError(MsphError):
    """An output file that could not be written completely."""


class BlowUpError(MsphError):
    """A simulation that is no longer finite, or has collapsed."""

    def __init__(self, what: str):
        super().__init__(f"the water blew up: {what}")


def did_you_mean(name: str, known: Iterable[str], kind: str = "known") -> str:
    """Returns a suggestion for an unknown name: the most similar known name, or all known names
    after the word `kind`."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=1, cutoff=MIN_SIMILARITY)
    return f"did you mean {near[0]!r}?" if near else f"{kind}: {', '.join(names) or 'none'}"
