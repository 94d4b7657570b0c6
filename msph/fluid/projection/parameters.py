"""Parameters of the projection method. Evidence for each default: docs/method.md."""

from msph.parameter import Section, parameter

# Largest motion in a step over the largest motion past neighbours (-): with 1.5 the bulk density of
# a dam break is off by 0.8 % at the impact instead of 0.6 %.
MOTION_FACTOR = 1.25


class ProjectionParameters(Section):
    """The incompressible method: a pressure solve and a position correction per step."""

    cfl: float = parameter(
        0.5,
        gt=0.0,
        le=1.0,
        text="limit of a particle's motion past its neighbours in a step, in spacings",
    )
    pressure_cfl: float = parameter(
        0.7, gt=0.0, le=2.0, text="limit of sqrt(p/rho) times the time step, in spacings"
    )
    longest_step: float = parameter(1.0 / 60.0, ge=1e-7, le=0.1, unit="s", text="longest time step")
    release: float = parameter(
        0.4, gt=0.0, unit="s", text="time in which a density excess becomes velocity"
    )
    tolerance: float = parameter(
        0.02,
        gt=0.0,
        lt=1.0,
        text="error of the pressure solve relative to the displacements by pressure",
        label="error allowed",
        live=(0.001, 0.5),
    )
    motion_tolerance: float = parameter(
        0.01,
        ge=0.0,
        lt=1.0,
        text="additional error of the pressure solve, relative to the motion in the step",
    )
    velocity_iterations: int = parameter(
        120, ge=1, le=100_000, text="iteration limit of the pressure solve"
    )
    position_iterations: int = parameter(
        4, ge=1, le=1000, text="iterations per round of the position correction"
    )
    largest_shift: float = parameter(
        0.25, gt=0.0, le=1.0, text="limit of a position correction, in spacings"
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
    slip: bool = parameter(True, text="true: the box does not brake viscous water; bodies never do")
    tension: float = parameter(
        0.0,
        ge=0.0,
        le=1e3,
        unit="N/m",
        text="surface tension, 0: off; water 0.072",
        label="surface tension",
        live=(0.01, 10.0),
    )
    shear_relief: float = parameter(
        1.0,
        ge=0.0,
        le=1.0,
        text="share of the particles' numerical friction that is removed, 0: off",
        label="liveliness of waves",
        live=(0.01, 1.0),
    )

    def contradiction(self) -> tuple[str, str] | None:
        """Returns a parameter that has no effect with the values of the others, and the reason, or
        None."""
        if not self.slip and not self.viscosity:
            return "slip", "only viscous water can stick to walls: set projection.viscosity"
        return None
