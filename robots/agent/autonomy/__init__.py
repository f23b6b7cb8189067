"""A robot's autonomy: it localizes itself, goes where it is sent, and docks.

`pose_extrapolator` runs on the control loop; `navigation_node` plans, in a process of its own. Both
are pure: readings and `now` in, velocities out.
"""
