"""Errors that a user is told of in one line."""


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
