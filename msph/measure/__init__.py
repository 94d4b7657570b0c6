"""Measurements: errors, conserved quantities, timings."""
