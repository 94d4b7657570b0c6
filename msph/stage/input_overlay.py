"""Base of an overlay that handles input before the player does (used by lessons)."""

from typing import Any

import numpy as np


class InputOverlay:
    """Overlay with its own keys, mouse input and pages; the base class has none."""

    below = 0  # height of its pages at the lower edge [pixels]
    taken: frozenset[str] = frozenset()  # keys that it handles

    @property
    def pauses(self) -> bool:
        """True while the overlay pauses the simulation."""
        return False

    @property
    def is_full_page(self) -> bool:
        """True while a page covers the whole image."""
        return False

    @property
    def runs(self) -> int:
        """Number of resets since the start."""
        return 0

    def handle_key(self, key: str) -> bool:
        """Handles a pressed key; returns False for a key of the player."""
        return False

    def is_on_page(self, cursor: np.ndarray) -> bool:
        """Returns True if a cursor, (right, up) in shares of the window, is on a page."""
        return False

    def drag(self, cursor: np.ndarray, down: bool, pressed: bool) -> bool:
        """Handles the left mouse button; returns True while the button holds a widget. pressed:
        True if the button was pressed in this frame."""
        return False

    def update(self) -> None:
        """Updates the overlay after a frame."""

    def draw(self, image: Any) -> None:
        """Draws its pages over an image."""
