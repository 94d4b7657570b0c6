"""Checks of a scene beyond its schema: geometry, references between tables, and memory."""

import itertools

import numpy as np
import psutil

from msph.errors import did_you_mean
from msph.fluid.adaptivity.bands import coarser_of
from msph.fluid.boundary.mesh_samples import sample_count
from msph.fluid.boundary.rigid_bodies import Body
from msph.fluid.boundary.walls import region
from msph.fluid.methods import METHODS, methods_with
from msph.fluid.particles.layers import LayerSpec
from msph.fluid.particles.particles import CORE
from msph.fluid.simulation import WORD, footprint
from msph.scene import schema
from msph.scene.bodies import check_bodies
from msph.scene.errors import TOLERANCE, SceneError, check_inside, in_metres, is_one_of
from msph.scene.motion import check_motion
from msph.scene.openings import check_openings
from msph.scene.probes import check_probes, probe_cautions
from msph.scene.schema import LAYER_OPTIONS, Layer, Scene, Water
from msph.scene.water import bounds, capacity, layer_specs, particle_count
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
    for i, layer in enumerate(scene.layers):
        if (layer.mass is None) == (layer.spacing is None):
            raise SceneError(where, "give either mass or spacing", f"layers.{i}")
    known = views(scene)
    if scene.picture.view not in known:
        hint = did_you_mean(scene.picture.view, known)
        raise SceneError(where, f"unknown view {scene.picture.view!r}; {hint}", "picture.view")
    if scene.box.open and scene.container:
        raise SceneError(where, "has no effect: no water leaves a container", "box.open")
    specs = layer_specs(scene)
    for i, spec in enumerate(specs):
        if spec.spacing > min(scene.box.size):
            raise SceneError(
                where,
                f"particles of {spec.spacing:.3g} m do not fit in the box, whose shortest edge "
                f"is {min(scene.box.size):.3g} m",
                f"layers.{i}",
            )
        least = METHODS[scene.method].MIN_SMOOTHING
        if spec.smoothing < least:
            raise SceneError(
                where,
                f"must be at least {least:g} for the method {scene.method} "
                f"(got {spec.smoothing:g})",
                f"layers.{i}.smoothing",
            )
    finest = min(s.support for s in specs)
    coarsest_cell = 0.5 * scene.surface.smoothing * finest
    if scene.surface.cell * min(s.spacing for s in specs) > coarsest_cell:
        most = coarsest_cell / min(s.spacing for s in specs)
        raise SceneError(
            where,
            f"is too coarse for surface.smoothing = {scene.surface.smoothing:g}; at most "
            f"{most:.4g} is allowed (got {scene.surface.cell:g})",
            "surface.cell",
        )
    for i, water in enumerate(scene.water):
        _check_water(scene, water, specs, where, f"water.{i}")
    for (i, a), (j, b) in itertools.combinations(enumerate(scene.water), 2):
        if _overlap(a, b):
            raise SceneError(where, f"overlaps water.{i}", f"water.{j}")
    contradiction = getattr(scene, scene.method).contradiction()
    if contradiction:
        name, problem = contradiction
        raise SceneError(where, problem, f"{scene.method}.{name}")
    _check_camera_path(scene, where)
    _check_layer_options(scene, where)
    _check_adaptation(scene, specs, where)
    solids = check_bodies(scene, min(specs, key=lambda s: s.mass).spacing, where)
    check_openings(scene, specs, where)
    check_motion(scene, where)
    check_probes(scene, where)
    _check_memory(scene, specs, solids, where)


def _check_camera_path(scene: Scene, where: str) -> None:
    """Raises SceneError for a single key frame, or for key frames that are not in order."""
    path = scene.camera.path
    if len(path) == 1:
        raise SceneError(where, "needs two key frames or more", "camera.path")
    for k, (before, key) in enumerate(itertools.pairwise(path), 1):
        if key.time <= before.time:
            raise SceneError(
                where,
                f"must be later than {before.time:g} s, the key frame before (got {key.time:g})",
                f"camera.path.{k}.time",
            )


def _check_adaptation(scene: Scene, specs: list[LayerSpec], where: str) -> None:
    """Raises SceneError if adaptation is enabled for a method that has none, without two layers
    that can exchange particles, or with a capacity below the initial number of particles."""
    if not scene.adaptation.enabled:
        return
    if not METHODS[scene.method].ADAPTS:
        raise SceneError(
            where,
            f"the method {scene.method} cannot adapt layers; {methods_with('ADAPTS')} can",
            "adaptation.enabled",
        )
    if all(k < 0 for k in coarser_of(specs)):
        masses = ", ".join(f"{s.mass:.3g}" for s in specs)
        raise SceneError(
            where,
            f"needs two layers whose particle masses are 1 : 2 (got {masses} kg)",
            "adaptation.enabled",
        )
    start = sum(particle_count(w, specs[w.layer]) for w in scene.water)
    if scene.adaptation.capacity is not None and scene.adaptation.capacity < start:
        raise SceneError(
            where,
            f"is below the {start:,} particles at the start (got {scene.adaptation.capacity:,})",
            "adaptation.capacity",
        )


def _check_layer_options(scene: Scene, where: str) -> None:
    """Raises SceneError for a layer option that the scene's method does not use."""
    used = METHODS[scene.method].LAYER_OPTIONS
    for i, layer in enumerate(scene.layers):
        for option in LAYER_OPTIONS:
            given = getattr(layer, option) != Layer.model_fields[option].default
            if given and option not in used:
                others = [n for n, s in METHODS.items() if option in s.LAYER_OPTIONS]
                raise SceneError(
                    where,
                    f"the method {scene.method} does not use this option; "
                    f"{' or '.join(others)} does",
                    f"layers.{i}.{option}",
                )


def _check_memory(scene: Scene, specs: list[LayerSpec], solids: list[Body], where: str) -> None:
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
    free = psutil.virtual_memory().available * MEMORY_SHARE
    if WORD * sum(needs.values()) > free or needs[largest] > MAX_NUMBERS:
        raise SceneError(
            where,
            f"{count:,} particles in a box of {in_metres(scene.box.size)} need "
            f"{WORD * sum(needs.values()) / 2**30:.1f} GiB, most of it for {largest}; "
            f"{free / 2**30:.1f} GiB are free",
            keys[largest],
        )


def _check_water(scene: Scene, water: Water, specs: list[LayerSpec], where: str, key: str) -> None:
    if water.layer >= len(scene.layers):
        raise SceneError(
            where,
            f"must be a layer's index from 0 to {len(scene.layers) - 1} (got {water.layer})",
            f"{key}.layer",
        )
    if not is_one_of((water.lo, water.hi), (water.centre, water.radius)):
        raise SceneError(where, "give either lo and hi, or centre and radius", key)
    lo, hi = bounds(water)
    if np.any(hi <= lo):
        raise SceneError(where, "has no volume: hi must exceed lo on every axis", f"{key}.hi")
    check_inside(lo, hi, scene.box.size, where, key)
    spec = specs[water.layer]
    most = particle_count(water.model_copy(update={"count": None}), spec)
    if water.count is not None and water.count > most:
        raise SceneError(
            where, f"{water.count} particles do not fit, there is room for {most}", f"{key}.count"
        )


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


def _overlap(a: Water | schema.Body, b: Water | schema.Body) -> bool:
    lo_a, hi_a = bounds(a)
    lo_b, hi_b = bounds(b)
    if a.radius is not None and b.radius is not None:
        apart = np.linalg.norm(np.array(a.centre) - np.array(b.centre))
        return bool(apart < a.radius + b.radius - TOLERANCE)
    for ball, lo, hi in ((a, lo_b, hi_b), (b, lo_a, hi_a)):
        if ball.radius is not None:
            centre = np.array(ball.centre)
            apart = np.linalg.norm(centre - np.clip(centre, lo, hi))
            return bool(apart < ball.radius - TOLERANCE)
    return bool(np.all(np.minimum(hi_a, hi_b) - np.maximum(lo_a, lo_b) > TOLERANCE))
