"""Markers to and from the Lab Streaming Layer, with which laboratories record EEG, gaze and the
like on one time line.
"""
