"""Speed-up of a layered scene over uniform water at its finest spacing, in alternating frames.

python bench/gains.py SCENE [--seconds 2] [--arch cpu]

Prints as JSON the speed-up and the ratio of the numbers of particles, means over frames.
`bench/scenes.py` runs it for every shipped scene.
"""

import json
import sys
import time
from pathlib import Path

import click
import numpy as np
import taichi as ti

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from bench.tanks import FRAME
from msph.device import ARCHES, start
from msph.scene import load_scene
from msph.scene.water import layer_specs
from msph.stage.controls import Controls
from msph.stage.show import Show


def uniform(name: str) -> tuple[str, ...]:
    """Returns the overrides that give all particles of an adaptive scene its finest size; () if the
    scene is not adaptive."""
    scene = load_scene(name)
    if not scene.adaptation.enabled:
        return ()
    finest = min(spec.mass for spec in layer_specs(scene))
    layers = [f"water.{k}.layer=0" for k in range(len(scene.water))]
    return f"layers=[{{ mass = {finest} }}]", "adaptation.enabled=false", *layers


@click.command()
@click.argument("scene")
@click.option("--seconds", default=2.0, show_default=True, help="Simulated time [s].")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(scene: str, seconds: float, arch: str) -> None:
    """Compare the adaptive SCENE with uniform water."""
    start(arch)
    # Without solver residuals, which need an additional neighbour search.
    shows = [
        Show(load_scene(scene, changes), FRAME, density_every=float("inf"))
        for changes in ((), uniform(scene))
    ]
    for show in shows:
        show.warm_up()
    times, counts = np.zeros(2), np.zeros(2)
    for _ in range(round(seconds / FRAME)):
        for k, show in enumerate(shows):
            ti.sync()
            begin = time.perf_counter()
            show.frame(Controls())
            ti.sync()
            times[k] += time.perf_counter() - begin
            counts[k] += sum(show.simulation.counts())
    faster, fewer = times[1] / times[0], counts[1] / counts[0]
    click.echo(json.dumps({"speed_up": faster, "particle_ratio": fewer}))


if __name__ == "__main__":
    main()
