"""Robots and visitors without bodies: many of each in one process, whose traffic is that of real
ones (see robots.py and visitors.py).
"""
