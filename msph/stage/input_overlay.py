"""Interface for an overlay that handles input before the player does (used by lessons)."""

from typing import Any, Protocol

import numpy as np


class InputOverlay(Protocol):
    """Overlay with keys, mouse input and pages of its own."""

    below: int  # height of its pages at the lower edge [pixels]
    taken: frozenset[str]  # keys that it handles

    @property
    def pauses(self) -> bool:
        """True while the overlay pauses the simulation."""

    @property
    def is_full_page(self) -> bool:
        """True while a page covers the whole image."""

    @property
    def runs(self) -> int:
        """Number of resets since the start."""

    def handle_key(self, key: str) -> bool:
        """Handles a pressed key; returns False for a key of the player."""

    def is_on_page(self, cursor: np.ndarray) -> bool:
        """Returns True if a cursor, (right, up) in shares of the window, is on a page."""

    def drag(self, cursor: np.ndarray, down: bool, pressed: bool) -> bool:
        """Handles the left mouse button, which is down now or not and was pressed in this frame or
        not; returns True while it holds a widget."""

    def update(self) -> None:
        """Updates the overlay after a frame."""

    def draw(self, image: Any) -> None:
        """Draws its pages over an image."""
