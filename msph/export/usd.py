"""A recording as a USD file: surface, droplets, bodies and camera with a time sample per frame.

The stage has metres, y up, and a time code per frame. /Tank follows the motion of the box; in it
are Water, a mesh with normals, velocities [m/s] for motion blur and the primvar foam; Droplets,
points with widths [m] and velocities; and Bodies, meshes with colours and transforms. /Camera is
the scene's.
"""

import importlib.util
import math
from pathlib import Path
from typing import Any

import numpy as np

from msph.export.files import body_looks
from msph.export.meshes import body_pose, shown_body, surface_arrays
from msph.fluid.boundary.body_faces import faces
from msph.own_files import writing
from msph.stage.show import Show

SUFFIXES = (".usd", ".usda", ".usdc")
# Height of a camera's film [mm], by which USD gives the field of view.
FILM = 24.0


def available() -> bool:
    """Returns True if usd-core is installed."""
    return importlib.util.find_spec("pxr") is not None


class Film:
    """A USD file that grows by a frame with add() and is written by close(). fps: frames per
    simulated second; aspect: width over height of the image."""

    def __init__(self, path: Path, fps: float, aspect: float, show: Show, layer: bool = False):
        from pxr import Sdf, Usd, UsdGeom, UsdShade, Vt

        self.path, self.show, self.layer = path, show, layer
        self.vt, self.shade, self.colour = Vt, UsdShade, Sdf.ValueTypeNames.Color3f
        # In memory: the file is written in one operation.
        self.stage = stage = Usd.Stage.CreateInMemory()
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(fps)
        stage.SetFramesPerSecond(fps)
        self.tank = UsdGeom.Xform.Define(stage, "/Tank").AddTransformOp()
        stage.SetDefaultPrim(stage.GetPrimAtPath("/Tank"))
        self.water = UsdGeom.Mesh.Define(stage, "/Tank/Water")
        self.water.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        primvars = UsdGeom.PrimvarsAPI(self.water)
        kinds = {"foam": Sdf.ValueTypeNames.FloatArray, "layer": Sdf.ValueTypeNames.IntArray}
        wanted = {name: kind for name, kind in kinds.items() if name == "foam" or layer}
        self.primvars = {
            name: primvars.CreatePrimvar(name, kind, UsdGeom.Tokens.vertex)
            for name, kind in wanted.items()
        }
        self.water.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
        self.droplets = UsdGeom.Points.Define(stage, "/Tank/Droplets")
        # With a type, since Blender drops the axes of what is below a prim without one.
        UsdGeom.Xform.Define(stage, "/Tank/Bodies")
        self.bodies = [self._body(UsdGeom, b, *look) for b, look in enumerate(body_looks(show))]
        self.camera = UsdGeom.Camera.Define(stage, "/Camera")
        self.camera.CreateVerticalApertureAttr(FILM)
        self.camera.CreateHorizontalApertureAttr(FILM * aspect)
        self.pose, self.aspect = self.camera.AddTransformOp(), aspect
        self.frames: list[int] = []

    def _body(self, geometry: Any, b: int, name: str, materials: list[Any]) -> Any:
        """Defines the mesh of a body at time zero and returns its transform."""
        mesh = faces(shown_body(self.show.simulation, b))
        safe = _path_name(name)
        made = geometry.Mesh.Define(self.stage, f"/Tank/Bodies/{safe}")
        made.CreateSubdivisionSchemeAttr(geometry.Tokens.none)
        made.CreatePointsAttr(self._vectors(mesh.vertices))
        self._set_faces(made, mesh.faces)
        colours = np.zeros((len(mesh.faces), 3))
        for material, colour, part in materials:
            colours[part] = colour
            own = _path_name(material)
            paint = self.shade.Material.Define(self.stage, f"/Materials/{own}")
            shader = self.shade.Shader.Define(self.stage, f"/Materials/{own}/Surface")
            shader.CreateIdAttr("UsdPreviewSurface")
            shader.CreateInput("diffuseColor", self.colour).Set(tuple(map(float, colour)))
            paint.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
            bound = made
            if len(materials) > 1:
                indices = self.vt.IntArray.FromNumpy(part.astype(np.int32))
                whole = self.shade.MaterialBindingAPI.Apply(made.GetPrim())
                bound = whole.CreateMaterialBindSubset(own, indices)
            self.shade.MaterialBindingAPI.Apply(bound.GetPrim()).Bind(paint)
        # One colour, or one per face.
        one = len(materials) == 1
        kind = geometry.Tokens.constant if one else geometry.Tokens.uniform
        shown = made.CreateDisplayColorPrimvar(kind)
        shown.Set(self._vectors(colours[:1] if one else colours))
        return made.AddTransformOp()

    def add(self, frame: int) -> None:
        """Adds the present state as time sample `frame`."""
        show, sim = self.show, self.show.simulation
        surface, white = show.display.surface, show.display.whitewater
        self.frames.append(frame)
        given = surface_arrays(surface.mesh, sim, white, self.layer)
        vertices, normals, triangles, arrays = given
        self.water.CreatePointsAttr().Set(self._vectors(vertices), frame)
        self.water.CreateNormalsAttr().Set(self._vectors(normals), frame)
        self.water.CreateVelocitiesAttr().Set(self._vectors(arrays["velocity"]), frame)
        self._set_faces(self.water, triangles, frame)
        self.primvars["foam"].Set(self._numbers(arrays["foam"]), frame)
        if self.layer:
            whole = self.vt.IntArray.FromNumpy(np.ascontiguousarray(arrays["layer"], np.int32))
            self.primvars["layer"].Set(whole, frame)
        x, radius, v = surface.thin.spray.droplets()
        if not len(x):  # Blender 5.0 crashes on points without a point: one of width 0
            x, radius, v = np.zeros((1, 3)), np.zeros(1), np.zeros((1, 3))
        self.droplets.CreatePointsAttr().Set(self._vectors(x), frame)
        self.droplets.CreateWidthsAttr().Set(self._numbers(2.0 * radius), frame)
        self.droplets.CreateVelocitiesAttr().Set(self._vectors(v), frame)
        middle, tilt, shift = 0.5 * np.array(sim.size), show.pose.tilt, show.pose.shift
        self.tank.Set(moved(tilt, middle + shift - tilt @ middle), frame)
        for b, body in enumerate(self.bodies):
            turn, at, start = body_pose(sim, b)
            body.Set(moved(turn, at - turn @ start), frame)
        camera = show.display.framing(aspect=self.aspect)
        self.pose.Set(moved(np.column_stack(camera.axes()), camera.eye), frame)
        self.camera.CreateFocalLengthAttr().Set(0.5 * FILM / math.tan(0.5 * camera.fov), frame)

    def close(self) -> None:
        """Writes the file."""
        if self.frames:
            self.stage.SetStartTimeCode(min(self.frames))
            self.stage.SetEndTimeCode(max(self.frames))
            with writing(self.path):
                self.stage.GetRootLayer().Export(str(self.path))

    def _set_faces(self, mesh: Any, triangles: np.ndarray, *frame: int) -> None:
        corners = np.ascontiguousarray(triangles, np.int32).ravel()
        counts = np.full(len(triangles), 3, np.int32)
        mesh.CreateFaceVertexIndicesAttr().Set(self.vt.IntArray.FromNumpy(corners), *frame)
        mesh.CreateFaceVertexCountsAttr().Set(self.vt.IntArray.FromNumpy(counts), *frame)

    def _vectors(self, values: np.ndarray) -> Any:
        return self.vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values, np.float32))

    def _numbers(self, values: np.ndarray) -> Any:
        return self.vt.FloatArray.FromNumpy(np.ascontiguousarray(values, np.float32))


def _path_name(name: str) -> str:
    """Returns a name in which other characters than letters and digits are underscores."""
    return "".join(c if c.isalnum() else "_" for c in name)


def moved(turn: np.ndarray, shift: np.ndarray) -> Any:
    """Returns the transform x -> turn x + shift as USD's matrix, which multiplies rows."""
    from pxr import Gf

    matrix = np.eye(4)
    matrix[:3, :3], matrix[3, :3] = turn.T, shift
    return Gf.Matrix4d(matrix.tolist())
