"""Path of the camera: key frames over time."""

import numpy as np

from msph.scene.observation import Camera, Orbit


def orbit_at(
    camera: Camera, time: float, centre: tuple[float, float, float]
) -> tuple[float, float, float, tuple[float, float, float]]:
    """Returns azimuth and elevation [deg], zoom (-) and target [m] of the camera at a time [s]: as
    given, or by monotone cubics (PCHIP) through the key frames of its path, constant before and
    after the path. centre: default target [m]."""

    def row(orbit: Orbit) -> tuple[float, ...]:
        return (orbit.azimuth, orbit.elevation, orbit.zoom, *(orbit.target or centre))

    if not camera.path:
        azimuth, elevation, zoom, *target = row(camera)
        return azimuth, elevation, zoom, (target[0], target[1], target[2])
    from scipy.interpolate import PchipInterpolator  # 0.2 s to import, and only paths need it

    times = np.array([key.time for key in camera.path])
    orbits = np.array([row(key) for key in camera.path])
    at = np.clip(time, times[0], times[-1])
    azimuth, elevation, zoom, x, y, z = PchipInterpolator(times, orbits)(at).tolist()
    return azimuth, elevation, zoom, (x, y, z)
