"""Measurements of the project's promises about time and load; results in benchmarks/results."""
