"""Estimates of a scene's preparation time and number of steps before it runs."""

import math

from msph.fluid.boundary.rigid_bodies import Body, Solid, bounding_radius
from msph.fluid.particles.layers import LayerSpec
from msph.scene.bodies import bodies, keys
from msph.scene.schema import Scene
from msph.scene.water import layer_specs, particle_count

# Elapsed time [s] per step, and per particle and step, on two cores: order of magnitude only
# (bench/results/peers.md, bench/results/scale.md).
STEP_TIME, PARTICLE_TIME = 1e-3, 2.5e-6
# Elapsed time [s] to sample the distances of one mesh face: two minutes for 1.3 million faces.
FACE_TIME = 9e-5
# Preparation time [s] and steps per simulated second above which a caution is given.
LONG_PREPARATION, MANY_STEPS = 10.0, 6000.0


def steps_per_second(scene: Scene, specs: list[LayerSpec], solids: list[Body]) -> tuple[float, str]:
    """Returns the least number of steps per simulated second [1/s] and the scene key that sets
    it."""
    d, h = min(s.spacing for s in specs), min(s.support for s in specs)
    if scene.method == "classic":
        sound = math.sqrt(scene.classic.stiffness)
        return sound / (scene.classic.courant * h), "classic.stiffness"
    p = scene.projection
    needed = {"projection.longest_step": 1.0 / p.longest_step}
    for key, body in zip(keys(scene), solids, strict=True):
        needed[key] = body.motion.top_speed(bounding_radius(body)) / (p.cfl * d)
    key = max(needed, key=lambda name: needed[name])
    return needed[key], key


def effort(scene: Scene) -> list[str]:
    """Returns one line each if the scene needs a long preparation or many steps: the cause, the
    number and the estimated elapsed time."""
    specs, solids = layer_specs(scene), bodies(scene)
    faces = sum(len(b.triangles) for b in solids if isinstance(b, Solid))
    lines = []
    preparation = faces * FACE_TIME
    if preparation > LONG_PREPARATION:
        lines.append(f"meshes of {faces:,} faces take about {in_words(preparation)} to prepare")
    steps, key = steps_per_second(scene, specs, solids)
    if steps >= MANY_STEPS:
        count = sum(particle_count(w, specs[w.layer]) for w in scene.water)
        elapsed = steps * (STEP_TIME + PARTICLE_TIME * count)
        lines.append(
            f"{key}: requires {steps:,.0f} steps per simulated second, which take roughly "
            f"{in_words(elapsed)}"
        )
    return lines


def in_words(seconds: float) -> str:
    """Formats a time [s] with two digits, in the largest fitting unit."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= size:
            number = f"{seconds / size:.2g}"
            return f"{number} {unit if number != '1' else unit[:-1]}"
    return f"{seconds:.2g} seconds"
