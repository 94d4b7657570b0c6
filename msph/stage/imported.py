"""What is imported once for all processes of waters, before they are forked."""

from msph.interrupts import importing

with importing():
    import msph.stage.commands  # noqa: F401
