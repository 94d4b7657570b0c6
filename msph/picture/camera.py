"""Orbit camera.

World frame: y up, metres. The minimum corner of the box is at the origin; a rotation R may turn the
box about its centre C: p_world = C + R (p_box - C).
"""

import math
from dataclasses import dataclass, field

import numpy as np

ELEVATION = np.radians((-80.0, 88.0))  # limits, short of the poles
ZOOM = (0.025, 4.0)  # limits of the distance, over the framing distance
# Largest distance of the target from the box's centre, over the distance of the eye or, if that is
# more, half the diagonal of the box; least height of the eye above the ground, over the box's.
PAN, CLEARANCE = 0.6, 0.05
MARGIN = 1.12  # least ratio of half of the image to the box's part of it, for lines of text


@dataclass
class Camera:
    """Camera that looks at `target` [m] from `distance` [m]. Angles are in radians; `fov` is
    vertical.

    shift: horizontal position of the target right of the image centre, in image widths. stretch:
    width over height of the display's pixels. Azimuth 0 looks along -z; larger azimuths move the
    eye to +x.
    """

    target: np.ndarray = field(default_factory=lambda: np.zeros(3))
    azimuth: float = 0.6
    elevation: float = 0.42
    distance: float = 2.5
    fov: float = 0.66
    shift: float = 0.0
    stretch: float = 1.0
    home: np.ndarray = field(default_factory=lambda: np.zeros(3))  # target before any pan [m]
    reach: tuple[float, float] = (0.05, 50.0)  # distance limits [m]

    @classmethod
    def framing(cls, box, aspect=16 / 9, azimuth=0.6, elevation=0.34, fov=0.72, below=MARGIN):
        """Returns a camera that shows the whole box (Lx, Ly, Lz) [m]. Angles are in radians; half
        of the image is at least MARGIN times the box's part of it, below the centre `below` times.
        """
        box = np.asarray(box, float)
        camera = cls(box / 2, azimuth, elevation, 1.0, fov)
        camera.home = box / 2
        right, up, back = camera.axes()
        corners = (np.indices((2, 2, 2)).reshape(3, 8).T - 0.5) * box
        tall = np.tan(fov / 2)
        x, y, z = corners @ right, corners @ up, corners @ back
        # A corner at (x, y, z) is in the image from the distance |y| / tall + z on.
        y = np.where(y > 0.0, MARGIN * y, -below * y)
        need = np.maximum(y / tall, np.abs(x) / (tall * aspect) * MARGIN) + z
        camera.distance = float(need.max())
        camera.reach = (ZOOM[0] * camera.distance, ZOOM[1] * camera.distance)
        return camera

    def orbit(self, azimuth, elevation):
        """Rotates around the target by two angles [rad]."""
        self.azimuth = float((self.azimuth + azimuth) % (2 * np.pi))
        self.elevation = float(np.clip(self.elevation + elevation, *ELEVATION))
        self._stay_above_ground()

    def zoom(self, factor):
        """Multiplies the distance; factors below 1 move closer."""
        self.distance = float(np.clip(self.distance * factor, *self.reach))
        self._stay_above_ground()

    def _stay_above_ground(self):
        """Raises the eye to CLEARANCE if it is lower."""
        rise = (2.0 * CLEARANCE * self.home[1] - self.target[1]) / self.distance
        lowest = math.asin(min(max(rise, -1.0), 1.0))
        self.elevation = max(self.elevation, lowest)

    def pan(self, right, up):
        """Moves the target along the axes of the view [m], within PAN of the box's centre."""
        x, y, _ = self.axes()
        moved = np.asarray(self.target) + right * x + up * y
        away = moved - self.home
        far = np.linalg.norm(away) / max(self.distance, np.linalg.norm(self.home))
        self.target = self.home + away / max(1.0, far / PAN)
        self._stay_above_ground()

    def axes(self):
        """Returns the unit vectors right, up and back of the view in the world frame."""
        ca, sa = math.cos(self.azimuth), math.sin(self.azimuth)
        ce, se = math.cos(self.elevation), math.sin(self.elevation)
        back = np.array((ce * sa, se, ce * ca))
        right, up = np.array((ca, 0.0, -sa)), np.array((-se * sa, ce, -se * ca))
        return right, up, back

    @property
    def eye(self):
        return np.asarray(self.target) + self.distance * self.axes()[2]

    def ray(self, i, j, width, height):
        """Returns eye and unit direction of the world ray through pixel (i right, j up)."""
        right, up, back = self.axes()
        step = 2 * np.tan(self.fov / 2) / height
        middle = (0.5 + self.shift) * width
        across, rise = (i + 0.5 - middle) * step * self.stretch, (j + 0.5 - height / 2) * step
        d = across * right + rise * up - back
        return self.eye, d / np.linalg.norm(d)

    def project(self, points, width, height, box, tilt=None):
        """Projects points (n, 3) of the box to image coordinates (n, 2): right and up, 0..1 in the
        image; NaN for points behind the eye."""
        R, C = np.eye(3) if tilt is None else np.asarray(tilt, float), np.asarray(box, float) / 2
        away = C + (np.asarray(points, float) - C) @ R.T - self.eye
        x, y, z = (away @ axis for axis in self.axes())
        depth = np.where(z < 0, -z, np.nan) * 2 * np.tan(self.fov / 2)
        across = x / depth * height / width / self.stretch
        return np.stack((0.5 + self.shift + across, 0.5 + y / depth), axis=-1)

    def box_ray(self, i, j, width, height, box, tilt=None):
        """Returns the ray of `ray` in box coordinates."""
        eye, d = self.ray(i, j, width, height)
        R, C = np.eye(3) if tilt is None else np.asarray(tilt, float), np.asarray(box, float) / 2
        return C + R.T @ (eye - C), R.T @ d

    def state(self):
        """Returns all values that the view depends on."""
        lens = self.fov, self.shift, self.stretch
        view = self.azimuth, self.elevation, self.distance, *lens
        return (*map(float, self.target), *view)
