"""Somebody beside the player of a window, such as the guide of a lesson."""

from typing import Any, Protocol

import numpy as np


class InputOverlay(Protocol):
    """Takes keys and the mouse first, and lays pages over the picture."""

    below: int  # height [pixels] that its pages take at the lower edge
    taken: frozenset[str]  # keys that are its own

    @property
    def waits(self) -> bool:
        """Whether the water waits."""

    @property
    def whole(self) -> bool:
        """Whether a page covers the picture."""

    @property
    def runs(self) -> int:
        """How often the water has begun anew."""

    def takes(self, key: str) -> bool: ...

    def covers(self, cursor: np.ndarray) -> bool: ...

    def drag(self, cursor: np.ndarray, down: bool) -> bool: ...

    def look(self) -> None: ...

    def lay(self, image: Any) -> None: ...
