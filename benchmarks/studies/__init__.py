"""Benchmarks of what a study makes of its sessions: reports, exports, and errors of its tests."""
