"""Board of error against time: measured costs of each quality of the shipped scenes."""

from typing import Any, ClassVar

from msph.lesson import chart
from msph.lesson.boards import Input, choice
from msph.options import AS_GIVEN, QUALITIES
from msph.scene.library import shipped_scenes
from msph.scene.quality import costs

# Measured costs by scene and quality.
COSTS = {name: steps for name in shipped_scenes() if (steps := costs(name))}


class Board(chart.Board):
    """Diagram of errors of the centre of mass against a finer run [% of the water's depth] over the
    elapsed time per simulated second, as measured in bench/results/quality.md."""

    NUMBERS: ClassVar[dict[str, str]] = {
        "cost": "s/s",
        "error": "%",
        "particles": "-",
        "best": "-",
    }
    INPUTS: ClassVar[dict[str, Input]] = {
        "scene": choice(tuple(name.replace("_", " ") for name in COSTS)),
        "quality": choice(QUALITIES, QUALITIES.index(AS_GIVEN)),
        "budget": Input("s/s", 1.0, 0.01, 100.0),
    }
    PANELS = (1,)

    def _chosen(self, values: dict[str, float]) -> tuple[str, str]:
        name = list(COSTS)[round(values["scene"]) - 1]
        return name, QUALITIES[round(values["quality"]) - 1]

    def numbers(self, values: dict[str, float]) -> dict[str, float]:
        """Returns the numbers of the chosen scene and quality; best: 1 if its error is the smallest
        within the budget, otherwise 0."""
        name, quality = self._chosen(values)
        steps = COSTS[name]
        within = [s for s in steps.values() if s.slowest <= values["budget"]]
        own = steps[quality]
        best = bool(within) and own == min(within, key=lambda s: s.error)
        return {
            "cost": own.slowest,
            "error": 100.0 * own.error,
            "particles": own.particles,
            "best": float(best),
        }

    def prepare(self, axes: list[Any]) -> None:
        (ax,) = axes
        ax.set(xscale="log", yscale="log", xlim=(0.02, 30.0), ylim=(0.01, 60.0))
        ax.minorticks_off()
        for axis in (ax.xaxis, ax.yaxis):
            axis.set_major_formatter("{x:g}")
        ax.set_xlabel("largest elapsed time per simulated second [s]")
        ax.set_ylabel("error [% of depth]")

    def paint(self, axes: list[Any], values: dict[str, float]) -> None:
        (ax,) = axes
        chosen, quality = self._chosen(values)
        for name, steps in COSTS.items():
            own = name == chosen
            x, y = ([getattr(s, k) for s in steps.values()] for k in ("slowest", "error"))
            y = [100.0 * e for e in y]
            colour = chart.COLOURS[1] if own else chart.FAINT
            ax.plot(x, y, "o-", color=colour, lw=3 if own else 1, alpha=1.0 if own else 0.5)
            if own:
                for step, a, b in zip(steps, x, y, strict=True):
                    points = ax.title.get_size()
                    style = {"textcoords": "offset points", "color": colour, "fontsize": points}
                    ax.annotate(step, (a, b), (8, 8), **style)
        numbers = self.numbers(values)
        ax.plot(numbers["cost"], numbers["error"], "o", ms=20, mfc="none", mec=chart.INK, mew=3)
        ax.axvspan(values["budget"], 1e3, color=chart.RED, alpha=0.18)
        ax.axvline(values["budget"], color=chart.RED, lw=2)
        ax.set_title(
            f"{chosen.replace('_', ' ')}, {quality}: {numbers['particles']:,.0f} particles"
        )
