"""Backup and restore of a whole site: archives, databases, and whole.py, which joins them."""
