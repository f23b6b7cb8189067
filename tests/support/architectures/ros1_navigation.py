"""Two nodes of ROS 1 in processes of their own, run by the Python that has rospy, which print what
they do as JSON lines.

`base` is a mobile base: it accelerates with 0.8 m/s², obeys the newest velocity on /cmd_vel, and
stops 0.5 s after it.

`planner HABIT TOPIC` is move_base, by actionlib's SimpleActionServer, and docks by services: it
publishes 0.3 m/s ten times a second while a goal is active or it docks. Habits: `obeys`; `misses`
the first two cancels, which the server never receives; `ignores` every cancel; `resumes` a second
after a cancel; `hesitates` 6 s before it accepts a goal (until then actionlib lists it as PENDING),
and answers a call to dock 12 s after it; `docks late` begins to dock only 12 s after the call.
"""

import json
import sys
import threading
import time

import rospy

ACCELERATION = 0.8
WATCHDOG = 0.5
SPEED = 0.3
MISSED = 2


def log(**event):
    sys.stdout.write(json.dumps({"at": time.monotonic(), **event}) + "\n")
    sys.stdout.flush()


def base():
    from geometry_msgs.msg import Twist
    from nav_msgs.msg import Odometry

    target = [0.0, 0.0]  # m/s, and its monotonic time

    def drive(message):
        target[:] = message.linear.x, time.monotonic()
        log(command=message.linear.x)

    rospy.init_node("base_driver", disable_signals=True, disable_rosout=True)
    rospy.Subscriber("/cmd_vel", Twist, drive, queue_size=1, tcp_nodelay=True)
    odometry = rospy.Publisher("/odom", Odometry, queue_size=1, tcp_nodelay=True)
    x, v, before, count = 0.0, 0.0, time.monotonic(), 0
    while True:
        time.sleep(0.01)
        now = time.monotonic()
        wanted = target[0] if now - target[1] < WATCHDOG else 0.0
        step = ACCELERATION * (now - before)
        v += min(max(wanted - v, -step), step)
        x += v * (now - before)
        before = now
        count += 1
        if count % 3 == 0:
            message = Odometry()
            message.header.stamp = rospy.Time.now()
            message.pose.pose.position.x, message.pose.pose.orientation.w = x, 1.0
            message.twist.twist.linear.x = v
            odometry.publish(message)
            log(x=x, v=v)


def planner(habit, topic):
    import actionlib
    from geometry_msgs.msg import Twist
    from move_base_msgs.msg import MoveBaseAction

    rospy.init_node("move_base", disable_signals=True, disable_rosout=True)
    velocity = rospy.Publisher(topic, Twist, queue_size=1, tcp_nodelay=True)

    def publish(speed):
        message = Twist()
        message.linear.x = speed
        velocity.publish(message)

    def execute(goal):
        log(started=goal.target_pose.pose.position.x)
        cancelled_at = None
        while True:
            if server.is_preempt_requested():
                cancelled_at = cancelled_at or time.monotonic()
                if habit not in {"ignores", "resumes"}:
                    break
            waits = cancelled_at is not None and time.monotonic() - cancelled_at < 1.0
            publish(0.0 if habit == "resumes" and waits else SPEED)
            time.sleep(0.1)
        publish(0.0)
        log(ended=goal.target_pose.pose.position.x)
        server.set_preempted()

    server = actionlib.SimpleActionServer("move_base", MoveBaseAction, execute, auto_start=False)
    inner, received = server.action_server, [0]
    cancel, accept = inner.internal_cancel_callback, server.internal_goal_callback
    cancelled = set()

    def take_cancel(goal_id):
        received[0] += 1
        log(cancel=goal_id.id)
        if habit != "misses" or received[0] > MISSED:
            cancelled.add(goal_id.id)
            cancel(goal_id)

    def accept_late(goal):
        accept(goal)
        if goal.get_goal_id().id in cancelled:
            server.internal_preempt_callback(goal)

    def take_goal(goal):
        log(received=goal.get_goal_id().id)
        if habit == "hesitates":
            threading.Timer(6.0, accept_late, [goal]).start()
        else:
            accept(goal)

    inner.internal_cancel_callback = take_cancel
    inner.goal_callback = take_goal
    server.start()
    docking = serve_docking(habit)
    log(ready=True)
    while True:
        docking.wait()
        publish(SPEED)
        time.sleep(0.1)


def serve_docking(habit):
    from std_srvs.srv import Trigger, TriggerResponse

    docking = threading.Event()

    def dock(_request):
        log(dock=True)
        if habit == "docks late":
            time.sleep(12.0)
        docking.set()
        log(docks=True)
        if habit == "hesitates":
            time.sleep(12.0)
        return TriggerResponse(True, "")

    def cancel_dock(_request):
        log(cancel_dock=True)
        docking.clear()
        return TriggerResponse(True, "")

    rospy.Service("/dock", Trigger, dock)
    rospy.Service("/cancel_dock", Trigger, cancel_dock)
    return docking


if __name__ == "__main__":
    {"base": base, "planner": planner}[sys.argv[1]](*sys.argv[2:])
