"""Tests that docs/method.md agrees with the code: the algorithm of a step, and quoted titles."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).parent.parent
SOLVER = ROOT / "msph" / "fluid" / "projection" / "solver.py"
TEXT = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")


def plain(name: str) -> str:
    """Returns a dotted name without `self.` and leading underscores."""
    return name.removeprefix("self.").lstrip("_")


def test_algorithm_has_the_calls_of_a_step_in_their_order():
    tree = ast.parse(SOLVER.read_text(encoding="utf-8"))
    step = next(n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef) and n.name == "step")
    calls = [n for n in ast.walk(step) if isinstance(n, ast.Call)]
    calls.sort(key=lambda call: (call.lineno, call.col_offset))
    in_code = [plain(ast.unparse(call.func)) for call in calls]

    box = TEXT.split("\n## A step\n")[1].split("```")[1]
    statements = [re.split(r"\s{2,}", line.strip())[0] for line in box.splitlines()]
    in_box = [name for line in statements for name in re.findall(r"([\w.]+)\(", line)]

    assert in_box == [name for name in in_code if name != "stage"]


def test_titles_that_code_refers_to_exist():
    quoted = re.compile(r'docs/(\w+)\.md,\s+(?:#\s*)?"([^"]+)"')
    found = 0
    for path in [*ROOT.glob("msph/**/*.py"), *ROOT.glob("bench/**/*.py")]:
        for name, title in quoted.findall(path.read_text(encoding="utf-8")):
            text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
            assert re.search(rf"^(#+ |\*\*){re.escape(title)}", text, re.MULTILINE), (path, title)
            found += 1
    assert found


def test_trials_have_the_titles_of_the_method():
    trials = (ROOT / "docs" / "trials.md").read_text(encoding="utf-8")
    titles = re.findall(r"^## .+$", trials, re.MULTILINE)
    assert titles and set(titles) <= set(re.findall(r"^## .+$", TEXT, re.MULTILINE))
