"""Sites: their plans, their maps, and casting rays in them. Pure numpy; knows no robot and no
network.
"""
