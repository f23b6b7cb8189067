"""A robot's autonomy, put together: it knows where it is, goes where it is told, and helps its
driver.

`pose_extrapolator` runs on the control loop, at once and at any time; `navigation_node` plans, in a
process of its own; `headless` is both in one, with the collision monitor, for studies and
benchmarks. All of them are pure: readings and `now` in, velocities out.
"""
