"""Adaptive resolution: splits and merges particles by their depth below the free surface."""
