"""The simulated robot's node of ROS 1, run by the Python that has rospy. Unlike the adapter's node,
it offers services, and runs on without a master as every rospy and roscpp node, which registers
only once (rospy/impl/registration.py, RegManager.start).
"""

import pathlib
import sys

sys.path.insert(
    0, str(pathlib.Path(__file__).resolve().parents[3] / "robots" / "agent" / "adapters" / "ros")
)

import ros1_node


class RobotNode(ros1_node.Node):
    def do_offer(self, service, kind):
        from std_srvs.srv import TriggerResponse

        def called(_request):
            self.say(op="publish", topic=service, content={})
            return TriggerResponse(True, "")

        self.subscribers.append(
            self.rospy.Service(service, self.roslib.message.get_service_class(kind), called)
        )

    def do_lose_publishers(self, topic):
        """Drop the publishers of a topic, as if rospy had not received their list."""
        from rospy.impl.registration import get_topic_manager

        subscriber = get_topic_manager().get_subscriber_impl(topic)
        for connection in list(subscriber.connections):
            subscriber.remove_connection(connection)
            connection.close()

    def watch_master(self):
        """Do nothing: a driver of ROS 1 does not watch its master."""


if __name__ == "__main__":
    sys.exit(ros1_node.main(RobotNode))
