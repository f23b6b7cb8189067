"""A robot's autonomy, put together: it knows where it is, goes where it is told, and helps its
driver.

`guard` runs on the control loop, at once and at any time; `node` thinks, in a process of its own;
`headless` is both in one, for studies and benchmarks. All of them are pure: readings and `now` in,
velocities out.
"""
