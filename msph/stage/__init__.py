"""The frame loop and its audiences: a window, a recorder, or nobody (the benchmark)."""
