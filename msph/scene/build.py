"""Building a simulation from a scene."""

from dataclasses import replace

from msph.fluid.plan import Plan
from msph.fluid.room import room_for
from msph.fluid.simulation import NoWaterError, OpeningError, Simulation
from msph.scene.bodies import bodies
from msph.scene.errors import SceneError
from msph.scene.openings import openings
from msph.scene.schema import Scene
from msph.scene.water import capacity, initial_particles, layer_specs
from msph.scene.wavemakers import beaches


def build_simulation(scene: Scene, spare: int = 0, room: int = 0) -> Simulation:
    """Returns a simulation of the scene; ti.init must have been called. spare: number of particles
    that may be added later, if the same class of fields holds them; room: least number of particles
    that the simulation must hold.

    Raises SceneError if the bodies leave no room for water, an inflow or an outflow.
    """
    try:
        return Simulation(roomy_plan_of(scene, spare, room))
    except NoWaterError:
        key = "container" if scene.container else "bodies"
        raise SceneError(scene.title, "no water is left outside the bodies", key) from None
    except OpeningError as error:
        k = error.opening - len(scene.inflows)
        key = f"inflows.{error.opening}" if k < 0 else f"outflows.{k}"
        raise SceneError(scene.title, str(error), key) from None


def roomy_plan_of(scene: Scene, spare: int, room: int = 0) -> Plan:
    """Returns the plan of build_simulation()."""
    plan = _with_spare(plan_of(scene), spare)
    return replace(plan, capacity=max(plan.max_particles, room))


def _with_spare(plan: Plan, spare: int) -> Plan:
    """Returns the plan with a larger capacity, or unchanged if this needs other fields."""
    larger = replace(plan, capacity=plan.max_particles + spare)
    return larger if room_for(plan.needed).holds(larger.needed) else plan


def plan_of(scene: Scene) -> Plan:
    """Returns the plan of a checked scene."""
    specs = layer_specs(scene)
    return Plan(
        size=scene.box.size,
        specs=specs,
        initial=initial_particles(scene, specs),
        parameters=getattr(scene, scene.method),
        bodies=bodies(scene),
        adaptation=scene.adaptation if scene.adaptation.enabled else None,
        capacity=capacity(scene, specs),
        restitution=scene.box.restitution,
        open_top=scene.box.open,
        openings=openings(scene, specs),
        beaches=beaches(scene),
    )
