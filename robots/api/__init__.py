"""Robot API version 1: the messages between pages, servers and robots.

Without Django and sockets: an agent on another computer needs nothing else of this project.
"""
