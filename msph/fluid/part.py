"""Base class of the objects with kernels on the fields of a fluid."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from msph.fluid.parts import Parts
else:
    Parts = object  # parts.py imports every part


class Part(Parts):
    """Object that has the parts of a fluid, as far as they exist, as attributes (parts.py)."""

    def __init__(self, parts: Parts):
        self.__dict__.update(vars(parts))
