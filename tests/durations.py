"""Durations of the tests, from the reports of the last `make test` and `make test-plain`.

make durations: writes tests/durations.json, by which conftest.py orders the files, and
bench/results/tests.md.
"""

import collections
import json
import sys
from pathlib import Path
from xml.etree import ElementTree

from tabulate import tabulate

DURATIONS = Path(__file__).with_name("durations.json")
ROOT = Path(__file__).resolve().parent.parent
# Reports of pytest by name of the run; number of the slowest tests that are listed.
RUNS, LISTED = ("test-water", "test", "test-plain"), 100


def read(run: str) -> list[tuple[str, str, float]]:
    """Returns file, test and duration [s] of each test of a run."""
    root = ElementTree.parse(ROOT / "out" / "tests" / f"{run}.xml").getroot()
    cases = [(case.attrib["classname"], case) for case in root.iter("testcase")]
    return [
        (f"{module.rsplit('.', 1)[-1]}.py", case.attrib["name"], float(case.attrib["time"]))
        for module, case in cases
    ]


def main() -> None:
    """Writes the durations of the last runs."""
    from bench.report import RESULTS, place

    found = {run: read(run) for run in RUNS}
    totals: collections.Counter[str] = collections.Counter()
    for run in RUNS[:2]:
        for file, _, seconds in found[run]:
            totals[file] += seconds
    seconds = {file: round(total) for file, total in totals.most_common()}
    DURATIONS.write_text(json.dumps(seconds, indent=0) + "\n")
    report = [
        f"# Durations of the tests\n\n{place('cpu', 2)}; `make test test-plain durations`\n",
        "Two processes of one thread each. Times include compiling, which the first test needing "
        "a\nkernel pays. Sums over tests of both processes:\n",
        tabulate(
            [[run, len(tests), f"{sum(t for *_, t in tests):.0f}"] for run, tests in found.items()],
            ["run", "tests", "s"],
            "github",
        ),
        f"\nThe {LISTED} slowest tests of `make test`:\n",
        tabulate(
            sorted(found[RUNS[0]] + found[RUNS[1]], key=lambda test: -test[2])[:LISTED],
            ["file", "test", "s"],
            "github",
            floatfmt=".1f",
        ),
        "",
    ]
    (RESULTS / "tests.md").write_text("\n".join(report))


if __name__ == "__main__":
    sys.exit(main())
