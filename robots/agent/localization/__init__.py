"""Where the robot is: a particle filter on the site's map, from odometry and a laser. Pure; no
clock and no thread of its own.
"""
