"""Particles of all layers: their pool, sizes, kernels, grids and neighbours."""
