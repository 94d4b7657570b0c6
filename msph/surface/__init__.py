"""The water's surface: coverage of the particles, marching cubes in a band, and the mesh.

surface = Surface(box_size, layers, grid, particles, cell=0.028)
surface.extract()            # a few launches, nothing read back
surface.mesh                 # Taichi fields: vertices, normals, triangles, counts
"""

from msph.surface.mesh import SurfaceMesh
from msph.surface.surface import Surface

__all__ = ["Surface", "SurfaceMesh"]
