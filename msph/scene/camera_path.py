"""Path of the camera: key frames over time."""

import numpy as np

from msph.scene.schema import Camera


def orbit_at(camera: Camera, time: float) -> tuple[float, float, float]:
    """Returns azimuth and elevation [deg] and zoom (-) at a time [s]: those of the camera, or
    monotone cubics (PCHIP) through the key frames of its path, constant before and after them."""
    if not camera.path:
        return camera.azimuth, camera.elevation, camera.zoom
    from scipy.interpolate import PchipInterpolator  # 0.2 s to import, and only paths need it

    times = np.array([key.time for key in camera.path])
    orbits = np.array([(key.azimuth, key.elevation, key.zoom) for key in camera.path])
    at = np.clip(time, times[0], times[-1])
    azimuth, elevation, zoom = PchipInterpolator(times, orbits)(at).tolist()
    return azimuth, elevation, zoom
