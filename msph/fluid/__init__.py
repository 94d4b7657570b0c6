"""Fluid simulation, independent of rendering, windows and file formats."""
