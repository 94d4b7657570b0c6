"""How long a scene will take, as far as that is known before it runs."""

import math

from msph.fluid.boundary.rigid_bodies import Body, Solid, bounding_radius
from msph.fluid.particles.layers import LayerSpec
from msph.scene.obstacles import bodies
from msph.scene.schema import Scene
from msph.scene.water import layer_specs, particle_count

# Wall-clock time of a step [s], and of each particle in it, on two cores (bench/results/peers.md,
# bench/results/scale.md): of the size, no more.
STEP, PARTICLE = 1e-3, 2.5e-6
# Wall-clock time [s] that a face of a mesh takes until its distances are sampled: 1.3 million took
# two minutes; and from which time on that is said.
FACE, LONG = 9e-5, 10.0
# Steps per simulated second from which on a scene is said to take long.
MANY = 6000.0


def steps_per_second(scene: Scene, specs: list[LayerSpec], solids: list[Body]) -> tuple[float, str]:
    """Fewest steps of a simulated second [1/s], and the key of what asks for them."""
    d, h = min(s.spacing for s in specs), min(s.support for s in specs)
    if scene.method == "classic":
        sound = math.sqrt(scene.classic.stiffness)
        return sound / (scene.classic.courant * h), "classic.stiffness"
    p = scene.projection
    asked = {"projection.longest_step": 1.0 / p.longest_step}
    outer = int(scene.container is not None)
    for k, body in enumerate(solids[outer:]):
        asked[f"obstacles.{k}"] = body.motion.top_speed(bounding_radius(body)) / (p.cfl * d)
    key = max(asked, key=lambda name: asked[name])
    return asked[key], key


def effort(scene: Scene) -> list[str]:
    """Lines where the scene will take long to prepare, or many steps: what asks for them, how many,
    how long."""
    specs, solids = layer_specs(scene), bodies(scene)
    faces = sum(len(b.triangles) for b in solids if isinstance(b, Solid))
    lines = []
    if faces * FACE > LONG:
        lines.append(f"meshes of {faces:,} faces take about {in_words(faces * FACE)} to prepare")
    steps, key = steps_per_second(scene, specs, solids)
    if steps < MANY:
        return lines
    count = sum(particle_count(w, specs[w.layer]) for w in scene.water)
    wall = steps * (STEP + PARTICLE * count)
    return [
        *lines,
        f"{key}: asks for {steps:,.0f} steps a simulated second, of the order of "
        f"{in_words(wall)} for each",
    ]


def in_words(seconds: float) -> str:
    """A time of two digits, in the unit that fits."""
    for size, unit in ((86400.0, "days"), (3600.0, "hours"), (60.0, "minutes")):
        if seconds >= size:
            return f"{seconds / size:.2g} {unit}"
    return f"{seconds:.2g} seconds"
