"""Simulated robots in which visitors practise while they wait."""
