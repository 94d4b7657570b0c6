"""Checks of a scene beyond its schema: geometry, references between tables, and memory."""

import itertools

import numpy as np
import psutil

from msph.fluid.adaptivity.bands import coarser_of
from msph.fluid.boundary.mesh_samples import sample_count
from msph.fluid.boundary.rigid_bodies import Ball, Body
from msph.fluid.boundary.walls import region
from msph.fluid.methods import METHODS, methods_with
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.particles import CORE
from msph.fluid.simulation import WORD, footprint
from msph.scene import schema
from msph.scene.bodies import check_bodies
from msph.scene.errors import (
    TOLERANCE,
    in_file,
    in_metres,
    is_one_of,
    require,
    require_inside,
    require_known,
    require_layer,
)
from msph.scene.motion import check_motion
from msph.scene.openings import check_openings
from msph.scene.probes import check_probes, probe_cautions
from msph.scene.schema import LAYER_OPTIONS, Layer, Scene, Water
from msph.scene.water import capacity, layer_specs, particle_count, shape_of
from msph.surface.room import SurfaceRoom

# Share of the free memory that a scene may take.
MEMORY_SHARE = 0.8
# Largest number of values in an array: indices are 32-bit integers.
MAX_NUMBERS = 2**31 - 1
# Particle spacings across a box or a gap below which pressures are inaccurate.
MIN_SPACINGS_ACROSS = 3
# Mass ratio of layers that meet above which densities are inaccurate: mixtures of 4 gain 0.3 % of
# their volume; bulk densities are 1.1 % off with 8, 5 % with 64 (bench/results/stability.md).
MAX_MASS_RATIO = 4.0


def views(scene: Scene) -> tuple[str, ...]:
    """Returns the views of the scene that can be rendered, in the order of the key that cycles
    through them."""
    parameters = getattr(scene, scene.method)
    attributes = CORE + METHODS[scene.method].attributes(parameters, scene.adaptation.enabled)
    return ("water", *(a.view for a in attributes if a.view), "particles")


def check(scene: Scene, where: str) -> None:
    """Raises SceneError if a scene that satisfies its schema cannot be built."""
    with in_file(where):
        _check(scene)


def _check(scene: Scene) -> None:
    for i, layer in enumerate(scene.layers):
        single = (layer.mass is None) != (layer.spacing is None)
        require(single, f"layers.{i}", "give either mass or spacing")
    require_known(scene.picture.view, views(scene), "view", "picture.view")
    closed = not (scene.box.open and scene.container)
    require(closed, "box.open", "has no effect: no water leaves a container")
    specs = layer_specs(scene)
    _check_sizes(scene, specs)
    for i, water in enumerate(scene.water):
        _check_water(scene, water, specs, f"water.{i}")
    for (i, a), (j, b) in itertools.combinations(enumerate(scene.water), 2):
        require(not _overlap(a, b), f"water.{j}", f"overlaps water.{i}")
    name, problem = getattr(scene, scene.method).contradiction() or ("", "")
    require(not problem, f"{scene.method}.{name}", problem)
    _check_camera_path(scene)
    _check_layer_options(scene)
    _check_adaptation(scene, specs)
    solids = check_bodies(scene, min(specs, key=lambda s: s.mass).spacing)
    check_openings(scene, specs)
    check_motion(scene)
    check_probes(scene)
    _check_memory(scene, specs, solids)


def _check_sizes(scene: Scene, specs: list[LayerSpec]) -> None:
    """Raises SceneError for particles larger than the box, supports too small for the method, and
    surface cells too large for the kernel."""
    shortest, least = min(scene.box.size), METHODS[scene.method].MIN_SMOOTHING
    for i, spec in enumerate(specs):
        require(
            spec.spacing <= shortest,
            f"layers.{i}",
            f"particles of {spec.spacing:.3g} m do not fit in the box, whose shortest edge "
            f"is {shortest:.3g} m",
        )
        require(
            spec.smoothing >= least,
            f"layers.{i}.smoothing",
            f"must be at least {least:g} for the method {scene.method} (got {spec.smoothing:g})",
        )
    cell, smoothing = scene.surface.cell, scene.surface.smoothing
    most = 0.5 * smoothing * min(s.support for s in specs) / min(s.spacing for s in specs)
    require(
        cell <= most,
        "surface.cell",
        f"is too coarse for surface.smoothing = {smoothing:g}; at most {most:.4g} is allowed "
        f"(got {cell:g})",
    )


def _check_camera_path(scene: Scene) -> None:
    """Raises SceneError for a single key frame, or for key frames that are not in order."""
    path = scene.camera.path
    require(len(path) != 1, "camera.path", "needs two key frames or more")
    for k, (before, key) in enumerate(itertools.pairwise(path), 1):
        require(
            key.time > before.time,
            f"camera.path.{k}.time",
            f"must be later than {before.time:g} s, the key frame before (got {key.time:g})",
        )


def _check_adaptation(scene: Scene, specs: list[LayerSpec]) -> None:
    """Raises SceneError if adaptation is enabled for a method that has none, without two layers
    that can exchange particles, or with a capacity below the initial number of particles."""
    if not scene.adaptation.enabled:
        return
    able, key = methods_with("ADAPTS"), "adaptation.enabled"
    problem = f"the method {scene.method} cannot adapt layers; {able} can"
    require(METHODS[scene.method].ADAPTS, key, problem)
    masses = ", ".join(f"{s.mass:.3g}" for s in specs)
    problem = f"needs two layers whose particle masses are 1 : 2 (got {masses} kg)"
    require(any(k >= 0 for k in coarser_of(specs)), key, problem)
    start = sum(particle_count(w, specs[w.layer]) for w in scene.water)
    most = start if scene.adaptation.capacity is None else scene.adaptation.capacity
    problem = f"is below the {start:,} particles at the start (got {most:,})"
    require(most >= start, "adaptation.capacity", problem)


def _check_layer_options(scene: Scene) -> None:
    """Raises SceneError for a layer option that the scene's method does not use."""
    used = METHODS[scene.method].LAYER_OPTIONS
    for option in (each for each in LAYER_OPTIONS if each not in used):
        others = " or ".join(n for n, s in METHODS.items() if option in s.LAYER_OPTIONS)
        problem = f"the method {scene.method} does not use this option; {others} does"
        for i, layer in enumerate(scene.layers):
            default = Layer.model_fields[option].default
            require(getattr(layer, option) == default, f"layers.{i}.{option}", problem)


def _check_memory(scene: Scene, specs: list[LayerSpec], solids: list[Body]) -> None:
    """Raises SceneError if the simulation and its surface do not fit into the free memory; image
    buffers are not counted, as their size is not part of the scene."""
    count = capacity(scene, specs)
    cell = scene.surface.cell * min(s.spacing for s in specs)
    extent = region(scene.box.size, scene.box.open)
    needs = footprint(extent, specs, count, getattr(scene, scene.method))
    needs["surface"] = SurfaceRoom.holding(extent, cell, count).bytes // WORD
    needs["bodies"] = sample_count(solids, specs)
    keys = {"cells": "box.size", "neighbours": "water", "images": "water", "particles": "water"}
    keys |= {"surface": "surface.cell", "bodies": "bodies"}
    largest = max(needs, key=lambda name: needs[name])
    total, free = WORD * sum(needs.values()), psutil.virtual_memory().available * MEMORY_SHARE
    require(
        total <= free and needs[largest] <= MAX_NUMBERS,
        keys[largest],
        f"{count:,} particles in a box of {in_metres(scene.box.size)} need {total / 2**30:.1f} "
        f"GiB, most of it for {largest}; {free / 2**30:.1f} GiB are free",
    )


def _check_water(scene: Scene, water: Water, specs: list[LayerSpec], key: str) -> None:
    require_layer(water.layer, len(specs), key)
    single = is_one_of((water.lo, water.hi), (water.centre, water.radius))
    require(single, key, "give either lo and hi, or centre and radius")
    lo, hi = shape_of(water).bounds
    require(np.all(hi > lo), f"{key}.hi", "has no volume: hi must exceed lo on every axis")
    require_inside(lo, hi, scene.box.size, key)
    most = particle_count(water.model_copy(update={"count": None}), specs[water.layer])
    problem = f"{water.count} particles do not fit, there is room for {most}"
    require((water.count or 0) <= most, f"{key}.count", problem)


def cautions(scene: Scene) -> list[str]:
    """Returns one line for each part of the scene that will be computed inaccurately."""
    edge, specs = min(scene.box.size), layer_specs(scene)
    coarse = [
        f"layers.{i}: pressures will be inaccurate, as the box's shortest edge of {edge:.3g} m is "
        f"less than {MIN_SPACINGS_ACROSS} spacings of {spec.spacing:.3g} m or a support of "
        f"{spec.support:.3g} m"
        for i, spec in enumerate(specs)
        if max(MIN_SPACINGS_ACROSS * spec.spacing, spec.support) > edge
    ]
    order = sorted(range(len(specs)), key=lambda i: specs[i].mass)
    unlike = [
        f"layers.{j}: densities will be off by about 1 % or more where it meets layers.{i}, "
        f"{specs[j].mass / specs[i].mass:.3g} times lighter: add layers between them"
        for i, j in itertools.pairwise(order)
        if specs[j].mass > MAX_MASS_RATIO * specs[i].mass
    ]
    return [*probe_cautions(scene), *_overlap_cautions(scene), *coarse, *unlike]


def _overlap_cautions(scene: Scene) -> list[str]:
    """Returns one line for each floating box or ball that overlaps another body at the start;
    meshes, and bodies that expressions place, are left out."""
    bodies = [
        (f"bodies.{k}", b, b.density is not None or b.mass is not None)
        for k, b in enumerate(scene.bodies)
        if b.mesh is None and not any((*b.displacement, b.angle))
    ]
    return [
        f"{key}: overlaps {other} at the start: they will be pushed apart"
        for i, (key, b, floats) in enumerate(bodies)
        for other, a, also in bodies[:i]
        if (floats or also) and _overlap(a, b)
    ]


def _overlap(a: Water | schema.BodyEntry, b: Water | schema.BodyEntry) -> bool:
    one, other = shape_of(a), shape_of(b)
    if isinstance(one, Ball) and isinstance(other, Ball):
        apart = np.linalg.norm(one.centre - other.centre)
        return bool(apart < one.radius + other.radius - TOLERANCE)
    if isinstance(one, Ball):
        one, other = other, one
    lo, hi = one.bounds
    if isinstance(other, Ball):
        apart = np.linalg.norm(other.centre - np.clip(other.centre, lo, hi))
        return bool(apart < other.radius - TOLERANCE)
    return bool(np.all(np.minimum(hi, other.hi) - np.maximum(lo, other.lo) > TOLERANCE))
