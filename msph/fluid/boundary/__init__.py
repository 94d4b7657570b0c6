"""Boundaries of the water: the walls of the box, bodies, and containers."""
