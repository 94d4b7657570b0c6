# make play: open the pool.  make test: run the fast tests.  make test-all: run all tests.
# Each sets itself up in .venv first.

PYTHONS := python3.12 python3.11 python3.13 python3.10 python3
VENV := .venv
RUN := $(VENV)/bin/python

# The first interpreter that starts and is one Taichi has wheels for.
PYTHON ?= $(shell for p in $(PYTHONS); do \
	$$p -c 'import sys; sys.exit(not (3, 10) <= sys.version_info < (3, 14))' 2>/dev/null \
	&& echo $$p && break; done)

# Python compiles the few modules that a start imports; pip would compile all, which takes longer.
LAZILY := $(if $(PYTHONDONTWRITEBYTECODE),,--no-compile)
INSTALL = $(RUN) -m pip install --quiet --disable-pip-version-check $(LAZILY) -c constraints.txt

.PHONY: play test test-slow test-all test-plain durations conformance installation check bench clean

play: $(VENV)/play
	@$(RUN) main.py

# Most of a test's time is compiling on one thread; files share what they compile, and are begun in
# the order of tests/conftest.py. Each run writes its times for `make durations`.
TEST = $(RUN) -m pytest -n 2 --dist loadfile --no-loadscope-reorder --junitxml=out/tests/$@.xml
ALL = tests --ignore=tests/test_conformance.py

# Each behaviour has a test here, which notices its gross failures.
test: $(VENV)/dev
	$(TEST) -m "not slow" $(ALL)

# Tests marked as slow: long simulations, real windows, lessons and notebooks.
test-slow: $(VENV)/dev
	$(TEST) -m slow $(ALL)

test-all: test test-slow

# The launcher, neighbours, solver and bodies once more without Taichi's private interfaces.
test-plain: $(VENV)/dev
	MSPH_PLAIN_TAICHI=1 $(TEST) tests/test_launches.py tests/fluid/test_grid.py \
		tests/fluid/test_projection.py tests/fluid/test_floating_bodies.py

# Records the CPU time of each of the last tests: the order of files, and bench/results/tests.md.
durations: $(VENV)/dev
	$(RUN) -m tests.durations

# Does another architecture compute what the CPU computes? make conformance ARCH=cuda
ARCH ?= vulkan
conformance: $(VENV)/dev
	MSPH_CONFORMANCE_ARCH=$(ARCH) $(RUN) -m pytest tests/test_conformance.py

# The program of docs/python.md with the package installed by pip into an empty environment.
installation: $(VENV)/dev
	MSPH_INSTALLATION=1 $(RUN) -m pytest tests/test_installation.py

check: $(VENV)/dev
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

bench: $(VENV)/dev
	$(RUN) bench/run.py

$(VENV)/play: pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "M-SPH needs Python 3.10 to 3.13; none of $(PYTHONS) is one" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
		{ echo "$(PYTHON) cannot make virtual environments; on Debian: apt-get install python3-venv" >&2; exit 1; }
	@echo "setting up $(VENV) with $(PYTHON), once"
	@$(PYTHON) -m venv $(VENV)
	@$(INSTALL) -e .
	@touch $@

$(VENV)/dev: $(VENV)/play
	@$(INSTALL) -e '.[dev]'
	@touch $@

clean:
	rm -rf $(VENV) build *.egg-info .pytest_cache .ruff_cache .mypy_cache
