"""What brute force over all pairs shares."""

# What an even expansion takes off a plain kernel sum, by support over spacing; see summation.py.
YIELD = {2.4: 0.9964, 2.5: 0.9970}


def pair_support(h, other):
    """Supports of all pairs (n, m), of particles whose own are h (n,) and other (m,)."""
    return (0.5 * (h[:, None] ** 2.5 + other**2.5)) ** 0.4


def relative_density(summed, smoothing):
    """c of plain sums of V_j W_ij, the particle's own included."""
    return 1.0 + (summed - 1.0) / YIELD[smoothing]
