"""Simulated robots with which visitors practise while they wait."""
