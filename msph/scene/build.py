"""From a scene to the simulation it describes."""

import math

import numpy as np

from msph.fluid.adaptation import AdaptationTerms
from msph.fluid.classic import ClassicTerms
from msph.fluid.methods import Terms
from msph.fluid.projection_terms import ProjectionTerms
from msph.fluid.simulation import NoWaterError, Simulation
from msph.scene.bodies import bodies
from msph.scene.errors import SceneError
from msph.scene.schema import Scene
from msph.scene.water import capacity, initial_particles, layer_specs


def build_simulation(scene: Scene) -> Simulation:
    """Allocates and fills everything the scene's fluid needs. ti.init must have been called.

    Raises SceneError where bodies leave no room for the water.
    """
    specs, initial = layer_specs(scene), initial_particles(scene)
    try:
        # Lattices fitted to their bodies may hold a few more than was expected.
        terms, most = solver_terms(scene), max(capacity(scene), len(initial["x"]))
        return Simulation(scene.box.size, specs, initial, terms, bodies(scene), most)
    except NoWaterError:
        key = "container" if scene.container else "obstacles"
        raise SceneError(scene.title, "no water is left outside of the bodies", key) from None


def solver_terms(scene: Scene) -> Terms:
    """The constants and switches of the scene's method."""
    if scene.method == "projection":
        adaptation = scene.adaptation.model_dump(exclude={"enabled", "capacity"})
        return ProjectionTerms(
            density=scene.density,
            restitution=scene.box.restitution,
            adaptation=AdaptationTerms(**adaptation) if scene.adaptation.enabled else None,
            **scene.projection.model_dump(),
        )
    c = scene.classic
    return ClassicTerms(
        density=scene.density,
        stiffness=c.stiffness,
        tension=c.tension,
        pressure_form=c.pressure_form,
        viscosity_form=c.viscosity_form,
        attraction=c.attraction,
        colour_threshold=c.colour_threshold,
        courant=c.courant,
        restitution=scene.box.restitution,
    )


def sway_angle(scene: Scene, time: float) -> float:
    """Tilt [rad] that the scene gives to its pool at `time` [s], about the z axis."""
    sway = scene.sway
    if time >= sway.seconds:
        return 0.0
    return math.radians(sway.angle) * math.sin(2.0 * math.pi * time / sway.period)


def turn(azimuth: float) -> np.ndarray:
    """Rotation by `azimuth` [rad] about y, (3, 3): world axes to those of a camera's orbit."""
    c, s = math.cos(azimuth), math.sin(azimuth)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def rotation(roll: float, pitch: float) -> np.ndarray:
    """Rotation box -> world, (3, 3): `roll` [rad] about z, then `pitch` [rad] about x."""
    cr, sr, cp, sp = math.cos(roll), math.sin(roll), math.cos(pitch), math.sin(pitch)
    about_z = np.array([[cr, -sr, 0.0], [sr, cr, 0.0], [0.0, 0.0, 1.0]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cp, -sp], [0.0, sp, cp]])
    return about_x @ about_z
