"""Worlds: simulations reuse the fields and kernels of earlier ones."""

import numpy as np
import pytest

from msph.fluid import world
from msph.fluid.external_forces import ExternalForces
from msph.fluid.room import FIRST, MAX_SIZE, Room, grown, room_for
from msph.launches import watch_compiling, watch_launches
from msph.options import QUALITIES
from msph.scene import build_simulation, load_scene
from msph.scene.build import plan_of
from msph.scene.library import shipped_scenes
from msph.scene.quality import at_quality, single_quality_reason
from msph.taichi_internals import PLAIN

FRAME = 1.0 / 60.0


def run(name, *overrides, frames=2):
    """Returns all carried attributes after some frames of a scene, at quality small if it has
    several, and gives the fields back."""
    scene = load_scene(name, overrides)
    if not single_quality_reason(scene):
        scene = at_quality(scene, "small", name)
    sim = build_simulation(scene)
    for _ in range(frames):
        sim.advance(FRAME, ExternalForces())
    state = sim.particles.state()
    sim.close()
    return state


def test_results_do_not_depend_on_scenes_run_before():
    names = ("still", "pillar", "pool")
    before = [run(name) for name in names]
    for other in ("bowl", "drop", "honey", "pool_2x"):
        run(other, frames=1)
    run("pool", "variant=system-3", "method=classic", frames=1)
    for name, first in zip(names, before, strict=True):
        after = run(name)
        assert first.keys() == after.keys()
        for attribute, values in first.items():
            assert np.array_equal(values, after[attribute]), (name, attribute)


@pytest.mark.skipif(PLAIN, reason="plain Taichi does not tell of kernels")
def test_scenes_share_kernels():
    for kind in ("drop", "bowl", "honey", "pool", "waves", "fountain", "lock"):
        run(kind, frames=1)
    compiled = []
    with watch_compiling(compiled.append):
        for name in shipped_scenes():
            run(name, frames=1)
    assert compiled == []


@pytest.mark.skipif(PLAIN, reason="plain Taichi does not tell of launches")
def test_scenes_without_bodies_launch_no_kernels_of_bodies():
    launched = set()
    with watch_launches(lambda owner, name: launched.add(name)):
        run("still", frames=1)
        without = set(launched)
        run("pillar", frames=1)
    of_bodies = {
        "meet_bodies",
        "find_links",
        "record",
    }
    assert not without & of_bodies
    assert of_bodies <= launched
    # Pressure in gaps is for bodies that float, and for forces that are recorded.
    assert "find_gaps" not in launched


@pytest.mark.skipif(PLAIN, reason="plain Taichi does not tell of launches")
@pytest.mark.parametrize(("name", "launches", "kernels"), [("pool", 21, 20), ("duck", 37, 32)])
def test_a_step_has_few_launches(name, launches, kernels):
    """Limits of the launches per step, without the iterations of the pressure solve, which are one
    launch each, and of the different kernels in a step."""
    sim, launched = build_simulation(load_scene(name)), []
    sim.advance(FRAME, ExternalForces())
    steps, iterations = sim.steps, sim.iterations
    with watch_launches(lambda owner, name: launched.append((type(owner).__name__, name))):
        sim.advance(FRAME, ExternalForces())
    assert len(launched) - (sim.iterations - iterations) <= launches * (sim.steps - steps)
    assert len(set(launched)) <= kernels
    sim.close()


def test_the_world_used_last_is_taken_first():
    """Of two equal worlds, the world that was given back last is taken: it has the kernels."""
    first, second = world.take(FIRST), world.take(FIRST)
    for given in (first, second):
        world.give_back(given)
    assert world.take(FIRST) is second
    world.give_back(second)
    assert world.take(FIRST) is second
    # The next tests get the world that has the kernels.
    assert world.take(FIRST) is first
    for given in (second, first):
        world.give_back(given)


def test_the_first_capacity_class_holds_every_shipped_scene():
    for name in shipped_scenes():
        for quality in QUALITIES:
            plan = plan_of(at_quality(load_scene(name), quality, name))
            assert FIRST.holds(plan.needed), (name, quality)


def test_capacities_grow_separately_and_up_to_the_range_of_indices():
    assert room_for(Room(1, 1, 1, 0, 0, 0)) == FIRST
    more = room_for(Room(FIRST.particles + 1, 1, 1, 0, 5 * FIRST.samples, 0))
    assert more.particles == 2 * FIRST.particles and more.samples == 8 * FIRST.samples
    assert (more.entries, more.cells, more.depth_cells) == (FIRST.entries, FIRST.cells, 30_000)
    assert grown(3, 3 * 2**20) == 3 * 2**20
    assert grown(FIRST.entries, MAX_SIZE + 1) == MAX_SIZE + 1


def test_sixty_four_bodies_and_a_container_fit():
    balls = [
        {"centre": [0.2 + 0.02 * (k % 8), 0.3, 0.2 + 0.02 * (k // 8)], "radius": 0.03}
        for k in range(64)
    ]
    scene = load_scene("bowl")
    bodies = [type(scene).model_fields["bodies"].annotation.__args__[0](**b) for b in balls]
    sim = build_simulation(scene.model_copy(update={"bodies": bodies}))
    assert sim.boundary.count == 65
    sim.advance(FRAME, ExternalForces())
    assert np.isfinite(sim.particles.numpy("x")).all()
    sim.close()
