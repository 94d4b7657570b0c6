"""The parameters of the projection method. Evidence for each default: docs/method.md."""

from msph.parameter import Section, parameter

# Distance in a step over that past neighbours, in cfl spacings (-): at 1.5 and 2 a dam break's bulk
# density was off by .8 and 1.3 % at the impact, not .6.
LEAP = 1.25


class ProjectionParameters(Section):
    """The incompressible method: two pressure solves a step."""

    cfl: float = parameter(
        0.5, gt=0.0, le=1.0, text="most spacings that a particle moves past neighbours in a step"
    )
    pressure_cfl: float = parameter(
        0.7, gt=0.0, le=2.0, text="most spacings that the speed sqrt(p/rho) covers in a step"
    )
    longest_step: float = parameter(
        1.0 / 60.0, ge=1e-7, le=0.1, unit="s", text="longest time step of slow water"
    )
    release: float = parameter(
        0.4, gt=0.0, unit="s", text="time in which a density excess may become velocity"
    )
    tolerance: float = parameter(
        0.02,
        gt=0.0,
        lt=1.0,
        text="share of the pressure's displacements that the velocity solve may leave",
        live=(0.001, 0.5),
    )
    motion_tolerance: float = parameter(
        0.01, ge=0.0, lt=1.0, text="or share of the way that the water goes in the step"
    )
    velocity_iterations: int = parameter(
        120, ge=1, le=100_000, text="most iterations of the velocity solve"
    )
    position_iterations: int = parameter(
        4, ge=1, le=1000, text="iterations of the position correction"
    )
    largest_shift: float = parameter(
        0.25, gt=0.0, le=1.0, text="most spacings of a position correction"
    )
    spray: float = parameter(
        0.4, ge=0.0, le=0.95, text="relative density below which water is spray"
    )
    viscosity: float = parameter(
        0.0,
        ge=0.0,
        le=1e5,
        unit="Pa s",
        text="dynamic viscosity, 0: off; water 0.001, honey 10",
        live=(0.1, 100.0),
    )
    slip: bool = parameter(True, text="the box does not brake viscous water; bodies never do")
    tension: float = parameter(
        0.0,
        ge=0.0,
        le=1e3,
        unit="N/m",
        text="surface tension, 0: off; water 0.072",
        live=(0.01, 10.0),
    )
    shear_relief: float = parameter(
        0.0,
        ge=0.0,
        le=1.0,
        text="share of the particles' false resistance to shear that is given back, 0: off",
        live=(0.01, 1.0),
    )
    xsph: float = parameter(
        0.0,
        ge=0.0,
        le=0.5,
        text="share of the way to its neighbours' velocity that water takes in a step, 0: off",
    )

    def contradiction(self) -> tuple[str, str] | None:
        """A parameter that says nothing beside the others, and why; None where all agree."""
        if not self.slip and not self.viscosity:
            return "slip", "only viscous water can stick to walls: set projection.viscosity"
        return None
