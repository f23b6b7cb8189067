"""Robot API version 1: the words that pages, servers and robots say to each other.

No Django, no sockets: an agent on another computer, and an agent in another language, need nothing
else of this project.
"""
