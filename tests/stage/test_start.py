"""Tests of what is compiled until the first image: numbers of kernels and of syntax nodes."""

import os

import pytest

from msph.taichi_internals import PLAIN
from tests.command_kit import python

# Renders the first images of scenes as `capture` does in a new process, and prints for each the
# numbers of compiled kernels and of syntax nodes that Taichi's front end visits.
SCRIPT = """
import sys
from msph.device import start
start("cpu")
from taichi.lang.ast.ast_transformer_utils import Builder
from msph.launches import watch_compiling
from msph.scene import load_scene
from msph.stage.controls import Controls
from msph.stage.link import Order
from msph.stage.preparation import prepare_row
build, nodes, kernels = Builder.__call__, [0], []

def count(self, context, node):
    nodes[0] += 1
    return build(self, context, node)

Builder.__call__ = count
for name in sys.argv[1:]:
    kernels.clear()
    nodes[0] = 0
    with watch_compiling(kernels.append):
        show = prepare_row(Order([load_scene(name)], options={}), (960, 540)).lead
        show.frame(Controls())
    show.close()
    print(len(kernels), nodes[0])
"""


@pytest.mark.slow
@pytest.mark.skipif(PLAIN, reason="plain Taichi does not tell of kernels")
def test_first_images_need_few_kernels_and_syntax_nodes() -> None:
    """Kernels and nodes decide how long a start takes. A limit that fails wants kernels that wait
    for their first use, or functions that are inlined at fewer places, not a higher limit.

    The second scene has bodies, and its numbers are of what it needs in addition to the first."""
    limits = {"pool": (63, 61_000), "duck": (60, 121_000)}
    result = python("-c", SCRIPT, *limits, env={**os.environ, "TI_ADVANCED_OPTIMIZATION": "0"})
    found = [tuple(map(int, line.split())) for line in result.stdout.splitlines()]
    for own, most in zip(found, limits.values(), strict=True):
        assert own[0] <= most[0] and own[1] <= most[1], found
