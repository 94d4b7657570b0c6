"""Tests of the imports between the program's modules."""

import ast
from pathlib import Path

import networkx

PACKAGE = Path(__file__).parent.parent / "msph"


def name_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imported(tree: ast.AST, known: set[str]) -> set[str]:
    """Returns the modules of `known` that a module names in imports, also in functions and for
    annotations only."""
    found = set[str]()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            parts = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= parts & known or {node.module}
    return found & known


def test_no_module_of_the_stage_is_in_a_circle_of_imports():
    paths = {name_of(path): path for path in PACKAGE.rglob("*.py")}
    graph = networkx.DiGraph()
    for name, path in paths.items():
        tree = ast.parse(path.read_text(encoding="utf-8"))
        graph.add_edges_from((name, other) for other in imported(tree, set(paths)))
    circles = [c for c in networkx.strongly_connected_components(graph) if len(c) > 1]
    assert not [c for c in circles if any(name.startswith("msph.stage.") for name in c)]
