"""Markers to and from the Lab Streaming Layer, which synchronizes laboratory recordings."""
