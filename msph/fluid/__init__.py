"""Fluid simulation. Independent of rendering, windows and file formats."""
