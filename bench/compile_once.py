"""Time from the selection of a scene to its first image in one process, and compiled kernels.

    python bench/compile_once.py                # every shipped scene at its own quality, twice
    python bench/compile_once.py --every        # the same at every quality

One row per scene: elapsed time until its first frame is simulated and rendered, and the kernels
that were compiled for it, on the first visit and on a later one. Results: results/compile_once.md.
"""

import time

import click
import psutil
import taichi as ti
from tabulate import tabulate

from msph.device import ARCHES, start
from msph.launches import watch_compiling
from msph.options import QUALITIES
from msph.scene import load_scene
from msph.scene.library import shipped_scenes
from msph.scene.quality import AS_GIVEN, at_quality
from msph.stage.controls import Controls
from msph.stage.row import Row
from msph.stage.show import INTERACTIVE, Show

# Image size [pixels]: the default of the window.
SIZE = (960, 540)


def visit(name: str, quality: str, before: Row | None) -> tuple[Row, float, int]:
    """Replaces the scene `before` by another; returns its row, the elapsed time [s], and the number
    of compiled kernels."""
    compiled: list[str] = []
    begin = time.perf_counter()
    with watch_compiling(compiled.append):
        if before:
            before.close()
        scene = at_quality(load_scene(name), quality, name)
        row = Row([Show(scene, 1.0 / scene.play.fps, SIZE, **INTERACTIVE)])
        row.frame(Controls())
        ti.sync()
    return row, time.perf_counter() - begin, len(compiled)


@click.command()
@click.option("--every", is_flag=True, help="Run every quality of each scene.")
@click.option("--arch", type=click.Choice(ARCHES), default="auto", show_default=True)
def main(every: bool, arch: str) -> None:
    """Print the table."""
    begin = time.perf_counter()
    start(arch)
    qualities = QUALITIES if every else (AS_GIVEN,)
    places = [(name, quality) for name in shipped_scenes() for quality in qualities]
    row: Row | None = None
    found: dict[tuple[str, str], list] = {place: list(place) for place in places}
    for _ in range(2):
        for name, quality in places:
            row, elapsed, kernels = visit(name, quality, row)
            found[name, quality] += [f"{elapsed:.2f}", kernels]
    heads = ["scene", "quality", "first visit, s", "kernels", "later, s", "kernels"]
    click.echo(tabulate(list(found.values()), headers=heads, tablefmt="github"))
    memory = psutil.Process().memory_info().rss / 2**20
    click.echo(f"total {time.perf_counter() - begin:.1f} s, memory of the process {memory:.0f} MiB")


if __name__ == "__main__":
    main()
