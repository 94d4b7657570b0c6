"""Prints results of a few scenes on one architecture, as JSON.

python -m tests.conformance_run ARCH
"""

import json
import sys
from typing import Any

import trimesh

from msph.device import start
from msph.scene import load_scene
from msph.scene.quality import at_quality
from msph.stage.controls import Controls
from msph.stage.show import Show

# In this order: layers without bodies, adaptation in a splash, closed container, moving bodies.
SCENES = ("still", "drop", "bowl", "paddle")
QUALITY, FRAME, FRAMES = "small", 1.0 / 60.0, 4
# Image size (width, height), and edge of the blocks whose mean colours are compared [pixels].
SIZE, BLOCK = (160, 90), 10


def facts(name: str) -> dict[str, Any]:
    """Returns results of a scene after FRAMES frames, in SI units; densities over the rest density,
    and mean colours of the blocks of the image over full brightness (-)."""
    show = Show(at_quality(load_scene(name), QUALITY, name), FRAME, SIZE, meshes=True)
    height = float(show.simulation.particles.numpy("x")[:, 1].max())
    for _ in range(FRAMES):
        show.frame(Controls())
    last = show.ledger.entries[-1]
    vertices, _, triangles = show.display.surface.mesh.to_numpy()
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    image = show.display.picture.to_numpy_u8() / 255.0
    blocks = image.reshape(SIZE[1] // BLOCK, BLOCK, SIZE[0] // BLOCK, BLOCK, 3).mean(axis=(1, 3))
    found = {
        "particles": show.simulation.particles.count,
        "mass": last.mass,
        "height": height,
        "kinetic": last.kinetic,
        "potential": last.potential,
        "density_mean": last.solver_residual_mean,
        "density_p99": last.solver_residual_p99,
        "outside": last.outside,
        "volume_error": show.volume_error(),
        "closed": bool(mesh.is_watertight and mesh.is_winding_consistent),
        "image": blocks.round(4).tolist(),
    }
    show.close()
    return found


if __name__ == "__main__":
    arch = start(sys.argv[1], tested=True)
    print(json.dumps({"arch": arch, "scenes": {name: facts(name) for name in SCENES}}))
