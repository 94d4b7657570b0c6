"""Lessons: predict, do, a check that ticks itself, why."""
