"""What brute force over all pairs shares."""

import numpy as np
import taichi as ti

# What an even expansion takes off a plain kernel sum, by support over spacing; see density.py.
YIELD = {2.4: 0.9964, 2.5: 0.9970}


def pair_support(h, other):
    """Supports of all pairs (n, m), of particles whose own are h (n,) and other (m,)."""
    return (0.5 * (h[:, None] ** 2.5 + other**2.5)) ** 0.4


def relative_density(summed, smoothing):
    """c of plain sums of V_j W_ij, the particle's own included."""
    return 1.0 + (summed - 1.0) / YIELD[smoothing]


def fill(field, values):
    """Sets a field (capacity,) to values (n,), and zero beyond."""
    field.from_numpy(np.pad(values.astype(np.float32), (0, field.shape[0] - len(values))))


def displacements(sim):
    """Displacements (n, 3) [m] by the velocity multipliers of a simulation's particles."""
    operator, p = sim.solver.pressure_solve.operator, sim.particles

    @ti.kernel
    def displace(n: ti.i32):
        operator.apply(n, p.velocity_multiplier)

    displace(p.count)
    return p.numpy("displacement").astype(float)


def quartic(r, h):
    """W [1/m^3] of the quartic B-spline at distances r of supports h [m]."""
    q = r / h
    terms = [(1, 1), (-5, 0.6), (10, 0.2)]
    w = sum(k * np.clip(end - q, 0, None) ** 4 for k, end in terms)
    return 15625 / (512 * np.pi * h**3) * w


def quartic_slope(r, h):
    """dW/dr [1/m^4]."""
    q = r / h
    terms = [(1, 1), (-5, 0.6), (10, 0.2)]
    w = sum(-4 * k * np.clip(end - q, 0, None) ** 3 for k, end in terms)
    return 15625 / (512 * np.pi * h**4) * w
