"""Shards of robots: which session manager serves which robot, and the epochs that fence it."""
