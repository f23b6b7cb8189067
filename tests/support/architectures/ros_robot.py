"""The messages that the simulated robot publishes and obeys as a robot of ROS 1 or 2, as JSON
objects, whatever carries them.
"""

import base64
import time
from collections import deque

from robots.agent.adapters.ros import messages
from tests.support.media.picture_server import jpeg_of

GREY = base64.b64encode(jpeg_of(128)).decode()
BASE = ("/cmd_vel", "geometry_msgs/Twist")
STAMPED = "geometry_msgs/TwistStamped"
DOCKING = {"/dock": "dock", "/undock": "undock", "/cancel_dock": "cancel"}  # service: method


class RosRobot:
    """Drives a world by the messages of the topics that it `hears`, and returns what it publishes
    as (topic, message) pairs; `version` is that of ROS, `base` the topic and type of velocities.

    Its move_base and Nav2 are the navigation of the world. Its messages arrive `late` seconds after
    they were stamped.
    """

    def __init__(self, world, version, base=BASE):
        self.world, self.version, self.base = world, version, base
        self.hears = dict([base]) | self.COMMANDS
        self.goal, self._told, self._fixed = None, "", 0.0
        self.cancelled = None
        self.stamps = []
        self.late, self._under_way = 0.0, deque()  # (when it arrives, topic, message)
        self._measured = False  # odometry was published since the restart

    TOPICS = {
        "/odom": "nav_msgs/Odometry",
        "/scan": "sensor_msgs/LaserScan",
        "/battery_state": "sensor_msgs/BatteryState",
        "/amcl_pose": "geometry_msgs/PoseWithCovarianceStamped",
        "/joint_states": "sensor_msgs/JointState",
        "/camera/compressed": "sensor_msgs/CompressedImage",
    }
    COMMANDS = {
        "/initialpose": "geometry_msgs/PoseWithCovarianceStamped",
        "/head/command": "std_msgs/Float64",
    }
    MOVE_BASE_HEARS = {
        "/move_base/goal": "move_base_msgs/MoveBaseActionGoal",
        "/move_base/cancel": "actionlib_msgs/GoalID",
    }
    MOVE_BASE_SAYS = {
        "/move_base/status": "actionlib_msgs/GoalStatusArray",
        "/move_base/result": "move_base_msgs/MoveBaseActionResult",
    }

    @property
    def options(self):
        """An adapter's options for the docking services and the head."""
        docking = {service.removeprefix("/"): service for service in DOCKING}
        head = {"tilt": "/head/command", "tilt_joint": "head_tilt"}
        return docking | (head if self.world.sim.model.tilt else {})

    def header(self, frame):
        return messages.header(frame, time.time(), self.version)

    def hear(self, topic, message):
        world = self.world
        if topic == self.base[0]:
            self.stamps.append(messages.stamp_in(message, 0.0))
            twist = message["twist"] if self.base[1] == STAMPED else message
            world.drive(twist["linear"]["x"], twist["angular"]["z"])
        elif topic == "/head/command":
            world.tilt(message["data"])
        elif topic == "/initialpose":
            self.relocalize(message)
        elif topic == "/move_base/goal":
            self.go(message["goal"]["target_pose"], message["goal_id"]["id"])
        elif topic == "/move_base/cancel" and message["id"] in {"", self.goal}:
            self.cancel()

    def cancel(self):
        """End the goal, even if the planner has not received it yet (RECALLED)."""
        if self.world.cancel():
            self.cancelled = self.goal

    def relocalize(self, message):
        """As amcl: a pose in another frame is ignored (amcl_node.cpp, handleInitialPoseMessage;
        nav2_amcl, initialPoseReceived).

        The new pose is published once, with the next scan, and again when the robot has moved.
        """
        if message["header"]["frame_id"] == "map" and not self.world.deaf:
            self.world.localize_at(messages.pose_in(message["pose"]["pose"]))
            self._fixed = 0.0

    def go(self, stamped, goal):
        assert stamped["header"]["frame_id"] == "map"
        place = messages.pose_in(stamped["pose"])
        self.goal = goal
        self._told = ""
        self.world.go_to(place.x, place.y)

    def due(self, count):
        """Return the messages that arrive in this tick of 20 ms."""
        now = time.monotonic()
        self._under_way += ((now + self.late, *each) for each in self._published(count))
        found = []
        while self._under_way and self._under_way[0][0] <= now:
            found.append(self._under_way.popleft()[1:])
        return found

    def _published(self, count):
        sim = self.world.sim
        found = []
        if count % 2 == 0:
            found.append(("/odom", self.odometry(sim)))
            self._measured = True
        if count % 5 == 1:
            found.append(("/scan", self.scan(sim)))
        if count % 10 == 2:
            found.append(("/battery_state", self.battery(sim)))
        if count % 3 == 0:
            found.append(("/joint_states", self.joints(sim)))
        if count % 5 == 3:
            frame = {"header": self.header("camera"), "format": "jpeg", "data": GREY}
            found.append(("/camera/compressed", frame))
        # As amcl: only while it moves, and after the odometry with which it is combined.
        is_due = sim.distance - self._fixed > 0.2 or self._fixed == 0.0
        if count % 2 and self._measured and is_due:
            self._fixed = max(sim.distance, 1e-6)
            found.append(("/amcl_pose", self.fix()))
        return found

    def restarted(self):
        self.late = 0.0
        self._under_way.clear()
        self._fixed, self._measured = 0.0, False
        self.goal = self.cancelled = None

    def odometry(self, sim):
        twist = {
            "linear": {"x": sim.motion.linear, "y": 0.0, "z": 0.0},
            "angular": {"x": 0.0, "y": 0.0, "z": sim.motion.angular},
        }
        where = {"pose": messages.pose(sim.odometry), "covariance": [0.0] * 36}
        return {
            "header": self.header("odom"),
            "child_frame_id": "base_link",
            "pose": where,
            "twist": {"twist": twist, "covariance": [0.0] * 36},
        }

    def fix(self):
        covariance = [0.0] * 36
        covariance[0] = covariance[7] = 0.0025
        covariance[35] = 0.001
        return {
            "header": self.header("map"),
            "pose": {"pose": messages.pose(self.world.believed), "covariance": covariance},
        }

    def scan(self, sim):
        laser = sim.model.laser
        return {
            "header": self.header("laser"),
            "angle_min": laser.angle_min,
            "angle_max": -laser.angle_min,
            "angle_increment": laser.angle_increment,
            "time_increment": 0.0,
            "scan_time": 0.1,
            "range_min": 0.05,
            "range_max": laser.range_max,
            "ranges": self.world.ranges().tolist(),
            "intensities": [],
        }

    def battery(self, sim):
        return {
            "header": self.header(""),
            "voltage": sim.voltage(),
            "percentage": sim.charge,
            "power_supply_status": 1 if sim.docked else 2,
            "present": True,
        }

    def joints(self, sim):
        return {
            "header": self.header(""),
            "name": ["wheel", "head_tilt"],
            "position": [0.0, sim.tilt],
            "velocity": [],
            "effort": [],
        }

    def goal_status(self):
        """actionlib's status of the newest goal, None before the planner has received it."""
        is_cancelled = self.cancelled == self.goal
        if self.world.journey == "":
            return 8 if is_cancelled else None
        return {"running": 1, "done": 3, "failed": 2 if is_cancelled else 4}[self.world.journey]

    def move_base_due(self, count):
        """Its status five times a second, also without a goal (actionlib/action_server.py)."""
        entry = {
            "goal_id": {"stamp": {"secs": 0, "nsecs": 0}, "id": self.goal},
            "status": self.goal_status(),
            "text": "",
        }
        header, found = self.header(""), []
        if count % 10 == 0:
            entries = [entry] if self.goal is not None and entry["status"] is not None else []
            found.append(("/move_base/status", {"header": header, "status_list": entries}))
        if self.goal is not None and self.over():
            found.append(("/move_base/result", {"header": header, "status": entry, "result": {}}))
        return found

    def over(self):
        """Return whether the journey has ended since the last call."""
        before, self._told = self._told, self.world.journey
        return before == "running" and self._told in {"done", "failed"}
