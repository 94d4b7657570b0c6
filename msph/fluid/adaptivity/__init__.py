"""Adaptive resolution: particles split and merge by their distance from the free surface."""
