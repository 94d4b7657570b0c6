"""Forces of the projection method, in the order in which a step applies them.

A new force is a subclass of Force and an entry in FORCES (docs/extending.md).
"""

from msph.fluid.projection.body_force import BodyForce
from msph.fluid.projection.force import Force
from msph.fluid.projection.shear_relief import ShearRelief
from msph.fluid.projection.surface_tension import SurfaceTension
from msph.fluid.projection.viscosity import Viscosity

FORCES: tuple[type[Force], ...] = (BodyForce, ShearRelief, SurfaceTension, Viscosity)
