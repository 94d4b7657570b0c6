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
    from PIL import Image

    content = _drawn(formula, 0.72 * height, colour, format="png", pad_inches=0.04)
    return np.asarray(Image.open(io.BytesIO(content)).convert("RGBA"))


def svg(formula: str) -> str:
    """Returns a formula as an <svg> element with its text as outlines."""
    text = _drawn(formula, 18, "black", format="svg", metadata={"Date": None}).decode()
    return text[text.index("<svg") :]


def _drawn(formula: str, size: float, colour: str, **options: Any) -> bytes:
    """Returns the image file of a formula; size of its text [points], options of savefig."""
    plt, file = pyplot(), io.BytesIO()
    figure = plt.figure(figsize=(0.01, 0.01), dpi=100)
    figure.text(0, 0, f"${formula}$", fontsize=size, color=colour)
    figure.savefig(file, transparent=True, bbox_inches="tight", **options)
    plt.close(figure)
    return file.getvalue()
