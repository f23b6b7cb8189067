"""The simulated robot's own node of ROS 1: besides what the adapter's node does, it offers
services, and goes on without a master as every rospy and roscpp node does, which registers once
(rospy/impl/registration.py, RegManager.start). Run by the Python that has rospy.
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

        heard = get_topic_manager().get_subscriber_impl(topic)
        for connection in list(heard.connections):
            heard.remove_connection(connection)
            connection.close()

    def watch_master(self):
        """Nothing: a driver of ROS 1 does not look after its master."""


if __name__ == "__main__":
    sys.exit(ros1_node.main(RobotNode))
