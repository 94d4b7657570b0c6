"""Tests of what is compiled until the first image: numbers of kernels and of syntax nodes."""

import os
import subprocess
import sys

import pytest

from msph.taichi_internals import PLAIN

# Renders the first image of a scene as `capture` does in a new process, and prints the numbers of
# compiled kernels and of syntax nodes that Taichi's front end visits.
SCRIPT = """
import sys
from msph.device import start
start("cpu")
from taichi.lang.ast.ast_transformer_utils import Builder
from msph.launches import use_stubs, watch_compiling
from msph.scene import load_scene
from msph.stage.controls import Controls
from msph.stage.preparation import prepare
use_stubs(None)
build, nodes, kernels = Builder.__call__, [0], []

def count(self, context, node):
    nodes[0] += 1
    return build(self, context, node)

Builder.__call__ = count
with watch_compiling(kernels.append):
    show = prepare(load_scene(sys.argv[1]), 1 / 30, (960, 540))
    show.frame(Controls())
print(len(kernels), nodes[0])
"""


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="plain Taichi does not tell of kernels")
@pytest.mark.parametrize(
    ("scene", "kernels", "nodes"), [("pool", 85, 80_000), ("duck", 95, 205_000)]
)
def test_first_image_needs_few_kernels_and_syntax_nodes(scene, kernels, nodes) -> None:
    """Kernels and nodes decide how long a start takes. A limit that fails wants kernels that wait
    for their first use, or functions that are inlined at fewer places, not a higher limit."""
    result = subprocess.run(
        [sys.executable, "-c", SCRIPT, scene],
        env={**os.environ, "TI_ADVANCED_OPTIMIZATION": "0"},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert result.returncode == 0, result.stderr
    found = [int(number) for number in result.stdout.split()]
    assert found[0] <= kernels and found[1] <= nodes, found
