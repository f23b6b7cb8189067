"""The network lab: a worse network than there is, for studies and for trying things out; nothing of
it is in the way while none is asked for.
"""
