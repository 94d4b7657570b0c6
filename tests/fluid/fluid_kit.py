"""What brute force over all pairs shares."""

import numpy as np


def raised(volume, other):
    """Kernel of unlike sizes over that of like ones, as summation.py says; all pairs."""
    small, large = (f(volume[:, None], other) for f in (np.minimum, np.maximum))
    return 1.0 + 0.5 * (1.0 - np.cbrt(small / large)) ** 2
