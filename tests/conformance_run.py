"""Facts of a few scenes on one architecture, as JSON: python -m tests.conformance_run ARCH."""

import json
import sys

import numpy as np

from msph.device import start
from msph.scene import load_scene
from msph.scene.quality import at_quality
from msph.stage.controls import Controls
from msph.stage.show import Show
from msph.surface import SurfaceMesh

# Layers without bodies, adaptation in a splash, a closed container, moving bodies.
SCENES = ("still", "drop", "bowl", "paddle")
QUALITY, FRAME, FRAMES, SIZE = "small", 1.0 / 60.0, 6, (160, 90)


def open_edges(mesh: SurfaceMesh) -> int:
    """Number of directed edges without exactly one opposite: 0 in a closed, oriented mesh."""
    triangles = mesh.to_numpy()[2]
    ends = np.concatenate([triangles[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    edges, counts = np.unique(ends, axis=0, return_counts=True)
    known = set(map(tuple, edges.tolist()))
    return int((counts != 1).sum()) + sum((b, a) not in known for a, b in known)


def facts(name: str) -> dict[str, float]:
    """Facts of a scene after FRAMES frames: SI units; densities and the image's channels over
    rest density and full brightness (-)."""
    show = Show(at_quality(load_scene(name), QUALITY, name), FRAME, SIZE, meshes=True)
    start_height = show.simulation.particles.numpy("x")[:, 1].astype(float)
    for _ in range(FRAMES):
        show.frame(Controls())
    last, mesh = show.ledger.entries[-1], show.surface.mesh
    image = show.picture.to_numpy_u8() / 255.0
    found = {
        "particles": show.simulation.particles.count,
        "mass": last.mass,
        "height": float(start_height.max()),
        "kinetic": last.kinetic,
        "potential": last.potential,
        "density_mean": last.density_error_mean,
        "density_p99": last.density_error_p99,
        "outside": last.outside,
        "volume_error": show.volume_error(),
        "open_edges": open_edges(mesh),
        "red": float(image[..., 0].mean()),
        "green": float(image[..., 1].mean()),
        "blue": float(image[..., 2].mean()),
        "contrast": float(image.std()),
    }
    show.close()
    return found


if __name__ == "__main__":
    arch = start(sys.argv[1])
    print(json.dumps({"arch": arch, "scenes": {name: facts(name) for name in SCENES}}))
