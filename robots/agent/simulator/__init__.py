"""A robot that does not exist: physics and senses (pure), and the process that runs them (server,
__main__).
"""
