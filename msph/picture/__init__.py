"""Rendering: Taichi kernels that draw pool, water and particles into one image field."""
