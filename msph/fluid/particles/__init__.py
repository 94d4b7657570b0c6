"""Particles of all layers: attributes, layer tables, kernels, grids and neighbour list."""
