"""The whole site in one file and back: archive (pure files), databases (one way for each engine),
and what joins them.
"""
