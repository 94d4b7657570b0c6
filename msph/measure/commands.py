"""The command `measure`: one run of a scene, or several at different spacings."""

import contextlib
from dataclasses import replace as replace_fields
from pathlib import Path

import click

from msph.errors import LostOutputError
from msph.measure import convergence, table
from msph.measure.measurement import CHECKPOINT, FILES, LEDGER, PROBES, SCENE, Measurement
from msph.measure.past import time_of
from msph.measure.plots import PLOTS, plot
from msph.measure.timings import Timings
from msph.options import MeasureOptions, RunOptions
from msph.own_files import claim, replace, written
from msph.scene import load_scene
from msph.scene.quality import with_spacings
from msph.scene.schema import Scene
from msph.scene.water import layer_specs
from msph.stage.link import Order
from msph.stage.loaded_scene import LoadedScene, at, exclude, options_of, with_input
from msph.stage.loop import run as run_loop
from msph.stage.preparation import prepare_row, say
from msph.stage.recorded_input import Recording, with_recording
from msph.stage.show import Show

# Output file of a convergence study.
CONVERGENCE = "convergence.csv"
# Share of the energy that is available for motion at the start (-) above which water splashes: 0.08
# in `drop`, 0.3 to 0.8 in `honey`, `pillar` and `dam_break`, at most 0.03 in the other scenes.
SPLASH = 0.05


def measure(scene: str | None, options: MeasureOptions, run: RunOptions) -> None:
    """Writes a scene's ledger, probes, summary and plots to a folder, and prints its errors."""
    exclude("--converge", options.converge, "--resume", options.resume)
    for option in ("resume", "converge", "every"):
        exclude("--replay", options.replay, f"--{option}", getattr(options, option))
    scene, run, recording = with_recording(scene, run, options.replay)
    since = time_of(Path(options.resume)) if options.resume else None
    given = {"duration": options.seconds, "measure.every": options.every}
    if recording:
        # A row for each recorded frame.
        recording = recording.cut(options.seconds)
        mean = recording.duration / recording.moving
        given = {"duration": recording.duration, "measure.every": mean}
    more = [f"{key}={value}" for key, value in given.items() if value is not None]
    found = load_scene(scene, (*run.overrides, *more))
    folder = options.folder or Path("out") / Path(scene).stem
    # A run that is resumed in its own folder continues its own files.
    own = options.resume is not None and Path(options.resume).resolve().parent == folder.resolve()
    claim_folder(folder, options.force or own)
    loaded = at(found, scene, run)
    if options.converge:
        measure_convergence(loaded, folder, options.converge, options.force)
    else:
        result = measured(loaded, folder, options.resume, since, recording)
        click.echo(f"\n{result.account()}")


def measured(
    loaded: LoadedScene,
    folder: Path,
    resume: str | None = None,
    since: float | None = None,
    recording: Recording | None = None,
) -> Measurement:
    """Measures one run of a scene from its start, or from a checkpoint `resume` at time `since`
    [s], with the input of a recording, if any; writes the results to a folder and prints the file
    names."""
    scene, row = loaded.scene, None
    options = {**options_of(recording, resume), "timings": Timings()}
    order = Order([scene], options=options, frame_time=scene.measure.every)
    if resume:
        # Before any file is written, as a checkpoint of another scene must not destroy the folder.
        row = prepare_row(order)
        row.lead.resume(Path(resume))
    measurement = Measurement(folder, scene, loaded.name, loaded.arch, since=since)
    replace(folder / SCENE, loaded.toml())
    try:
        row = row or prepare_row(order)
        run_loop(row, with_input(measurement, recording))
    except (Exception, KeyboardInterrupt) as error:
        try:
            measurement.conclude(str(error) or "interrupted")
        except LostOutputError as lost:
            say(str(lost))
        say(f"{folder} holds the results until then")
        if written(folder / CHECKPOINT):
            say(f"--resume {folder / CHECKPOINT} continues the run")
        raise
    paths = measurement.conclude()
    row.close()
    paths += plot(folder, f"{scene.title or loaded.name}, quality {loaded.quality}")
    for path in paths:
        click.echo(path)
    return measurement


def measure_convergence(loaded: LoadedScene, folder: Path, runs: int, force: bool) -> None:
    """Measures a scene at several spacings, coarsest first, each in a subfolder, and estimates the
    discretisation error. Raises SceneError if the spacing cannot change, ExistingFileError for
    existing files, unless `force`."""
    name = loaded.name
    claim([folder / CONVERGENCE], force)
    scaled = list(with_spacings(loaded.scene, convergence.factors(runs), name))
    folders = [folder if f == 1.0 else folder / f"spacings_x{f:.2f}" for f, _ in scaled]
    for each in folders:
        claim_folder(each, force)
    share = available_energy(scaled[0][1])
    if share > SPLASH:
        say(
            f"warning: {name}: the water falls or collapses at the start ({100.0 * share:.0f} % of "
            "its potential energy is available): splashes depend on each particle, so that most "
            "figures will not converge, and their errors remain unknown"
        )
    spacings: list[float] = []
    for (factor, coarse), each in zip(scaled, folders, strict=True):
        spacings.append(min(s.spacing for s in layer_specs(coarse)))
        say(f"{name}: finest spacing {1e3 * spacings[-1]:.4g} mm, run {len(spacings)} of {runs}")
        quality = f"{loaded.quality}, spacings x{factor:.2f}"
        finest = measured(replace_fields(loaded, scene=coarse, quality=quality), each)
    ledgers, probes = ([table.read(f / file) for f in folders] for file in (LEDGER, PROBES))
    rows = convergence.compare(ledgers, probes, spacings[-1])
    convergence.write(folder / CONVERGENCE, rows, spacings)
    finest.add("discretisation", convergence.as_json(rows))
    click.echo(folder / CONVERGENCE)
    click.echo(f"\n{finest.account()}")
    click.echo(f"\nDiscretisation error of {name}\n{convergence.text(rows, spacings)}")


def available_energy(scene: Scene) -> float:
    """Returns the energy of the motion and of the water above its level at the start, over its
    potential energy above the floor (-)."""
    with contextlib.closing(Show(scene, scene.measure.every)) as show:
        show.ledger.record(show.gravity())
        reference = show.ledger.reference_energy()
        return show.ledger.motion_energy() / reference if reference > 0.0 else 0.0


def claim_folder(folder: Path, force: bool) -> None:
    """Claims all files that a measurement writes to a folder. Raises ExistingFileError."""
    claim([folder / name for name in (*FILES, *PLOTS)], force)
