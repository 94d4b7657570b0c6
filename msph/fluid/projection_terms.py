"""The constants of the projection method."""

from dataclasses import dataclass

from msph.fluid.adaptation import AdaptationTerms


@dataclass(frozen=True)
class ProjectionTerms:
    """Constants of the projection method.

    density rho0 [kg/m^3]. The time step is bounded by cfl (-), dt <= cfl d/|v|, v past neighbours
    and walls, by pressure_cfl (-), dt <= pressure_cfl d/sqrt(p/rho0), here d of the pairs, and by
    longest_step [s] for slow, shallow water. A dam break at cfl .4, .5 and .6 keeps the same energy
    to a hundredth of what it began with, and densities as near to rest; at .2 it loses three more,
    for each step spreads particles.
    release [s]: time in which a density excess, or a slight deficit, may become velocity; the rest
    of the excess is for the position solve, of position_iterations, at most largest_shift spacings
    a step. tolerance (-): share of the pressure's displacements that the velocity solve may leave,
    or motion_tolerance (-) of the way that the water goes in the step, less what it goes as a
    whole, in velocity_iterations at most.
    spray: relative density below which no rate of compression can be told (-). Counting
    neighbours instead lets water in edges of the box, which has few, gain energy. viscosity
    [Pa s], slip at walls, tension [N/m] of the surface and xsph (-): 0 is off. adaptation: None
    where every particle keeps its layer.
    """

    density: float = 1000.0
    restitution: float = 0.0
    cfl: float = 0.5
    pressure_cfl: float = 0.7
    longest_step: float = 1.0 / 60.0
    release: float = 0.4
    tolerance: float = 0.02
    motion_tolerance: float = 0.01
    velocity_iterations: int = 120
    position_iterations: int = 4
    largest_shift: float = 0.25
    spray: float = 0.4
    viscosity: float = 0.0
    slip: bool = True
    tension: float = 0.0
    xsph: float = 0.0
    adaptation: AdaptationTerms | None = None
