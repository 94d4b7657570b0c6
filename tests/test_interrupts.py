"""Signals while libraries are imported: tests/stage/test_recorder.py has those of runs."""

import signal
import warnings

import pytest

from msph.interrupts import end_at_once, importing


def test_an_import_that_fails_gives_interrupts_back():
    """It left Ctrl-C to end the process for good."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(ImportError), importing():
            assert signal.getsignal(signal.SIGINT) is end_at_once
            raise ImportError("no such library")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_only_deprecations_of_libraries_are_kept_from_users():
    """What Taichi lacks, for which kernels are launched slowly, was not said."""
    with warnings.catch_warnings(record=True) as heard, importing():
        warnings.simplefilter("always", UserWarning)
        warnings.warn("taichi lacks something", stacklevel=1)
        warnings.warn("an old name", DeprecationWarning, stacklevel=1)
    assert [str(w.message) for w in heard] == ["taichi lacks something"]
