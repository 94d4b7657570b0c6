"""Parameters of the classic method."""

from typing import Literal

from msph.parameter import Section, parameter


class ClassicParameters(Section):
    """The weakly compressible method of the thesis (Gokdogan 2008).

    (32) and (33) use the gradient averaged over both supports. With the neighbour's support alone
    (33) would be (27) divided by rho_i, and neither form would be antisymmetric between layers,
    which is their purpose. attraction acts by the colour field (Mueller et al. 2003, eq. 17 to 19).
    """

    stiffness: float = parameter(
        200.0,
        gt=0.0,
        le=1e7,
        unit="m^2/s^2",
        text="k of p = k (rho - rho0), the square of the speed of sound",
        live=(1.0, 2000.0),
    )
    viscosity: float = parameter(
        10.0,
        ge=0.0,
        le=1e4,
        unit="Pa s",
        text="dynamic viscosity mu of layers without their own",
        live=(0.0, 100.0),
    )
    tension: bool = parameter(
        True, text="allow negative pressures, as the formula of the thesis does"
    )
    pressure_form: Literal["mean", "squared", "product"] = parameter(
        "mean", text="pressure force: mean (27), or symmetrised: squared (32), product (33)"
    )
    viscosity_form: Literal["formula", "pseudocode"] = parameter(
        "formula", text="viscous force: formula (28), or the pseudo-code of A.2"
    )
    attraction: float = parameter(
        0.0, ge=0.0, unit="N/m", text="surface attraction by the colour field, 0: off"
    )
    colour_threshold: float = parameter(
        0.5, gt=0.0, text="colour gradient times h above which the attraction acts"
    )
    courant: float = parameter(
        0.4,
        ge=0.01,
        le=10.0,
        text="time step over the time that sound takes to cross h",
        live=(0.05, 1.0),
    )

    def contradiction(self) -> tuple[str, str] | None:
        """Returns None: every parameter has an effect."""
        return None
