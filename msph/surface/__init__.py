"""Water surface: coverage of the particles, marching cubes in a band of cells, and the mesh.

surface = state.build_once(surface_of, room)
surface.load(box_size, cell=0.028)  # for each scene that fits in the room
surface.extract()  # a few kernel launches, nothing is read back
surface.mesh  # vertices, normals, triangles, counts: Taichi fields
"""

from msph.surface.mesh import SurfaceMesh
from msph.surface.room import SurfaceRoom
from msph.surface.surface import Surface, surface_of

__all__ = ["Surface", "SurfaceMesh", "SurfaceRoom", "surface_of"]
