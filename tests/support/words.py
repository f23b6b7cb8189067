"""Messages of robots and pages, with defaults for all fields."""

from robots.api import messages as m


def online(boot="b1"):
    return m.Connection(boot=boot, state="ONLINE", stamp=1.0)


def broken(boot="b1"):
    return m.Connection(boot=boot, state="CONNECTIONBROKEN", stamp=2.0)


def state(seq=1, **changes):
    fields = {
        "stamp": 100.0 + seq / 4,
        "boot": "b1",
        "seq": seq,
        "pose": m.Pose(x=1.0, y=2.0, theta=0.5),
        "velocity": m.Velocity(linear=0.0, angular=0.0),
        "battery": m.Battery(charge=0.8),
    }
    return m.State(**{**fields, **changes})


def applied(seq=1, **changes):
    """Return a command as the robot applied it."""
    fields = {"seq": seq, "stamp": 100.0 + seq / 4, "method": "keyboard", "way": "datachannel"}
    fields |= {"age": 0.01, "linear": 0.3, "angular": 0.0}
    return m.AppliedCommand(**{**fields, **changes})


def factsheet(name="giraff", **changes):
    speeds = {"linear": 0.7, "reverse": 0.3, "angular": 0.7}
    accelerations = {"linear_acceleration": 0.2, "angular_acceleration": 0.4}
    limits = m.Limits(**speeds, **accelerations, linear_braking=1.0, angular_braking=2.0)
    fields = {
        "name": name,
        "series": "Giraff",
        "rca": "simulator",
        "agent_version": "1",
        "boot": "b1",
        "capabilities": ("velocity", "video"),
        "limits": limits,
        "footprint": ((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2)),
        "watchdog": 0.5,
    }
    return m.Factsheet(**{**fields, **changes})


def velocity(seq=1, **changes):
    """Return a command of a page; the server replaces its session and epoch."""
    fields = {"session": "forged", "epoch": 999, "seq": seq, "stamp": 100.0}
    fields |= {"linear": 0.2, "angular": 0.0, "method": "keyboard"}
    return m.VelocityCommand(**{**fields, **changes})


def lease(**changes):
    fields = {"session": "s1", "epoch": 1, "peer": "p1", "who": "Ada", "renewal": 0, "stamp": 1.0}
    return m.Lease(**{**fields, **changes})


def pose(stamp=1.0):
    at, motion = m.Pose(x=0.0, y=0.0, theta=0.0), m.Velocity(linear=0.1, angular=0.0)
    return m.PoseUpdate(stamp=stamp, pose=at, velocity=motion)
