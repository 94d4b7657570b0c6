"""Helpers of the surface tests: conversion to trimesh, lattices to fill, a small box of water."""

from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from msph.fluid.boundary.rigid_bodies import Body
from msph.state import Moment, state_of
from msph.surface import SurfaceMesh, SurfaceRoom, surface_of
from msph.surface.lattice import Lattice
from msph.surface.marching_cubes import MarchingCubes
from tests.fluid.fluid_kit import lattice, simulate, spec_of

SIZE = (0.6, 0.5, 0.4)
FINE = 0.03  # spacing of the finer layer [m]
COARSE = FINE * 2 ** (1 / 3)
CELL = 0.6 * FINE


def as_trimesh(mesh: SurfaceMesh) -> trimesh.Trimesh:
    vertices, _, triangles = mesh.to_numpy()
    return trimesh.Trimesh(vertices.astype(np.float64), triangles, process=False)


def assert_closed(mesh: SurfaceMesh) -> None:
    """Asserts that the mesh is closed, oriented and manifold: every edge has exactly two faces, and
    every vertex is used."""
    solid = as_trimesh(mesh)
    assert solid.is_watertight and solid.is_winding_consistent
    _, faces = np.unique(np.sort(solid.edges, axis=1), axis=0, return_counts=True)
    assert (faces == 2).all()
    assert len(np.unique(solid.faces)) == len(solid.vertices)
    assert mesh.overflowed() is None


def middles(mesh: SurfaceMesh) -> np.ndarray:
    """Returns the centres of the triangles (t, 3) [m], in the order of their creation."""
    vertices, _, triangles = mesh.to_numpy()
    return vertices.astype(np.float64)[triangles].mean(axis=1)


def assert_same(first: np.ndarray, again: np.ndarray) -> None:
    """Asserts that two meshes of the same water, given by middles(), are equal to rounding.

    Triangles may differ in order, since threads bin particles and add volumes in any order.
    """
    distance, partner = cKDTree(first).query(again)
    assert len(first) == len(again)
    assert distance.max() < 1e-4 * FINE
    assert len(np.unique(partner)) == len(first)


def uniform(shape, spacing=(1.0, 1.0, 1.0), origin=(0.0, 0.0, 0.0)) -> Lattice:
    """Returns a lattice with nodes at origin + spacing * index."""
    triples = zip(shape, spacing, origin, strict=True)
    return Lattice([o + s * np.arange(n) for n, s, o in triples])


class Cubes:
    """Marching cubes over a whole lattice, with node values given as numpy arrays."""

    def __init__(self, lattice: Lattice, cubes: MarchingCubes):
        self.lattice, self.cubes = lattice, cubes

    def nodes(self) -> np.ndarray:
        """Returns the node positions (3, nx, ny, nz)."""
        axes = [a.astype(np.float64) for a in self.lattice.axes]
        return np.stack(np.meshgrid(*axes, indexing="ij"))

    def extract(self, value: np.ndarray, gradient: np.ndarray | None = None) -> SurfaceMesh:
        value = np.asarray(value)
        if gradient is None:
            gradient = np.zeros((3, *value.shape))
        self.cubes.load_field(self.lattice, value, np.moveaxis(gradient, 0, -1))
        self.cubes.run()
        return self.cubes.mesh


class Water:
    """Box of water with two layers and a surface, refilled by every test."""

    def __init__(
        self,
        bodies: Sequence[Body] = (),
        room: SurfaceRoom = SurfaceRoom(),  # noqa: B008
    ):
        specs = [spec_of(d, 2.0) for d in (FINE, COARSE)]
        x = np.array([[0.3, 0.25, 0.2]])
        self.simulation = sim = simulate(SIZE, specs, x, bodies=bodies, capacity=6000)
        self.layers, self.particles, self.grid = sim.layers, sim.particles, sim.grid
        self.boundary = sim.boundary
        self.state = sim.world.build_once(state_of)
        self.state.load(sim.plan)
        self.surface = self.state.build_once(surface_of, room)
        self.surface.load(SIZE, CELL)
        # Otherwise particles are spray that have the numbers of loose ones of an earlier test.
        self.surface.reset()

    def nodes(self, field) -> np.ndarray:
        """Returns a flat field over the lattice's nodes as (nx, ny, nz) or (nx, ny, nz, 3)."""
        lattice = self.surface.lattice
        flat = field.to_numpy()[: np.prod(lattice.padded)]
        whole = flat.reshape(*lattice.padded, *flat.shape[1:])
        return whole[tuple(slice(n) for n in lattice.shape)]

    @property
    def volume(self) -> float:
        """Volume of all particles [m^3]."""
        volumes = np.array([s.volume for s in self.layers.specs])
        return float(volumes[self.particles.numpy("layer")].sum())

    def fill(self, x: np.ndarray, layer: np.ndarray | int = 0) -> None:
        x = np.asarray(x, dtype=np.float32).reshape(-1, 3)
        layer = np.broadcast_to(np.asarray(layer, dtype=np.int32), len(x))
        self.particles.fill(x=x, layer=layer)
        self.grid.build()

    def take(self) -> None:
        """Copies the particles to the state, from which the surface is extracted."""
        self.state.take(self.simulation, Moment())

    def mesh(self, everywhere: bool = False, for_image: bool = False) -> SurfaceMesh:
        """Returns the extracted mesh; for_image: see Surface.extract. everywhere: evaluates
        the whole box, with bounds by which no sub-block counts as air or deep water."""
        numbers = self.surface.cubes.numbers
        bounds = {"air_below": -1.0, "deep_above": 1e9, "half_diagonal": 1e9} if everywhere else {}
        loaded = {name: getattr(numbers, name)[None] for name in bounds}
        for name, bound in bounds.items():
            getattr(numbers, name)[None] = bound
        self.take()
        with self.state.at_frame():
            self.surface.extract(for_image)
        for name, bound in loaded.items():
            getattr(numbers, name)[None] = bound
        return self.surface.mesh

    def closed_mesh(self, x: np.ndarray, layer: np.ndarray | int = 0) -> SurfaceMesh:
        """Fills the box with particles; returns their mesh, which must be closed."""
        self.fill(x, layer)
        mesh = self.mesh()
        assert_closed(mesh)
        return mesh


def packed(low, high, d: float, jitter: float = 0.0, seed: int = 0) -> np.ndarray:
    """Returns a lattice of particles (n, 3) [m] with a spacing close to d [m] that fills the box
    from low to high [m]; jitter: largest displacement along each axis, in spacings."""
    low, high = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    counts = np.maximum(1, np.round((high - low) / d).astype(int))
    unit = lattice(counts, 1.0) / counts
    noise = np.random.default_rng(seed).uniform(-jitter, jitter, unit.shape) * d
    return np.clip(low + unit * (high - low) + noise, 1e-4, np.array(SIZE) - 1e-4)
