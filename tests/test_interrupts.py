"""Tests of signals during imports; tests/stage/test_recorder.py tests signals during runs."""

import signal
import warnings

import pytest

from msph.interrupts import end_at_once, importing


def test_a_failed_import_restores_the_signal_handlers():
    """Regression: from then on Ctrl-C ended the process at once, as during imports."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(ImportError), importing():
            assert signal.getsignal(signal.SIGINT) is end_at_once
            raise ImportError("no such library")
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)


def test_imports_hide_deprecation_warnings_only():
    """Regression: the warning that launches are slower was hidden."""
    with warnings.catch_warnings(record=True) as heard, importing():
        warnings.simplefilter("always", UserWarning)
        warnings.warn("taichi lacks something", stacklevel=1)
        warnings.warn("an old name", DeprecationWarning, stacklevel=1)
    assert [str(w.message) for w in heard] == ["taichi lacks something"]
