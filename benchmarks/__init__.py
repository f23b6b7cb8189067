"""What the project promises about time and load, measured; results in benchmarks/results."""
