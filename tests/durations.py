"""CPU times of the tests, from the reports that `make test-all` and `make test-plain` have left.

make durations: writes tests/durations.json, by which conftest.py orders the files, and the first
part of bench/results/tests.md; the part from the heading KEPT on is written by hand.
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
RUNS, LISTED = ("test", "test-slow", "test-plain"), 50
KEPT = "## Before the tiers"


def report_of(run: str) -> Path:
    return ROOT / "out" / "tests" / f"{run}.xml"


def read(run: str) -> list[tuple[str, str, float]]:
    """Returns file, test and CPU time [s] of each test of a run."""
    found = []
    for case in ElementTree.parse(report_of(run)).getroot().iter("testcase"):
        (file,) = (part for part in case.attrib["classname"].split(".") if part.startswith("test_"))
        cpu = case.find("properties/property[@name='cpu']")
        seconds = 0.0 if cpu is None else float(cpu.attrib["value"])  # none if skipped
        found.append((f"{file}.py", case.attrib["name"], seconds))
    return found


def main() -> None:
    """Writes the durations of the last runs."""
    from bench.rows import RESULTS, place

    found = {run: read(run) for run in RUNS if report_of(run).exists()}
    tiers = [run for run in RUNS[:2] if run in found]
    totals: collections.Counter[str] = collections.Counter()
    for run in tiers:
        for file, _, seconds in found[run]:
            totals[file] += seconds
    seconds = {file: round(total) for file, total in totals.most_common()}
    DURATIONS.write_text(json.dumps(seconds, indent=0) + "\n")
    report = [
        f"# Durations of the tests\n\n{place('cpu', 2)}; `make test-all test-plain durations`\n",
        "CPU time of two processes of one thread each and of the processes that tests start. Times "
        "include\ncompiling, which the first test needing a kernel pays:\n",
        tabulate(
            [[run, len(tests), f"{sum(t for *_, t in tests):.0f}"] for run, tests in found.items()],
            ["run", "tests", "s"],
            "github",
        ),
        f"\nThe {LISTED} slowest tests of each tier:\n",
        tabulate(
            [
                (run, *test)
                for run in tiers
                for test in sorted(found[run], key=lambda test: -test[2])[:LISTED]
            ],
            ["run", "file", "test", "s"],
            "github",
            floatfmt=".1f",
        ),
        "",
    ]
    path = RESULTS / "tests.md"
    kept = "".join(path.read_text().partition(KEPT)[1:])
    path.write_text("\n".join([*report, kept]) if kept else "\n".join(report))


if __name__ == "__main__":
    sys.exit(main())
