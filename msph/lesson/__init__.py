"""Lessons: a question, tasks that are checked off automatically, and an explanation."""
