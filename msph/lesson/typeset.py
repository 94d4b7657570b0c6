"""Formulas typeset by matplotlib, as pixels for the window and as SVG for web pages."""

import io
from typing import Any

import numpy as np

from msph.errors import BadInputError


class FormulaError(BadInputError):
    """A formula that cannot be typeset."""


def pyplot() -> Any:
    """Returns matplotlib.pyplot with a backend that draws into memory; 0.5 s to import."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    return plt


def check_formula(formula: str) -> None:
    """Raises FormulaError if a formula cannot be typeset."""
    pyplot()
    from matplotlib.mathtext import MathTextParser

    try:
        MathTextParser("path").parse(f"${formula}$")
    except RecursionError:
        raise FormulaError("cannot be typeset: too many nested groups") from None
    except ValueError as error:
        problem = str(error).strip().splitlines()[-1]
        raise FormulaError(f"cannot be typeset: {problem}") from None


def pixels(formula: str, height: int, colour: str) -> np.ndarray:
    """Returns a formula as RGBA (rows, columns, 4) uint8, first row at the top; height of its text
    [pixels]."""
    plt = pyplot()
    figure = plt.figure(figsize=(0.01, 0.01), dpi=100)
    figure.text(0, 0, f"${formula}$", fontsize=0.72 * height, color=colour)
    file = io.BytesIO()
    figure.savefig(file, format="png", transparent=True, bbox_inches="tight", pad_inches=0.04)
    plt.close(figure)
    from PIL import Image

    file.seek(0)
    return np.asarray(Image.open(file).convert("RGBA"))


def svg(formula: str) -> str:
    """Returns a formula as an <svg> element with its text as outlines."""
    plt = pyplot()
    figure = plt.figure(figsize=(0.01, 0.01))
    figure.text(0, 0, f"${formula}$", fontsize=18)
    file = io.StringIO()
    figure.savefig(
        file, format="svg", transparent=True, bbox_inches="tight", metadata={"Date": None}
    )
    plt.close(figure)
    text = file.getvalue()
    return text[text.index("<svg") :]
