"""What rosapi tells of topics, which takes several questions."""

from robots.agent.adapters import registry

NOBODY = {
    "/rosapi/subscribers": {"subscribers": []},
    "/rosapi/publishers": {"publishers": []},
    "/rosapi/topics": {"topics": [], "types": []},
}
BASE = NOBODY | {
    "/rosapi/subscribers": {"subscribers": ["/base_driver"]},
    "/rosapi/topics": {"topics": ["/cmd_vel"], "types": ["geometry_msgs/TwistStamped"]},
}


async def test_a_subscriber_that_connects_between_two_requests_has_a_type_or_is_not_listed():
    bus = registry.create(
        "rosbridge", "rhodon", {"navigation": "none", "url": "ws://127.0.0.1:1", "version": "1"}
    )._bus
    asked = []

    async def values(service, *_):
        asked.append(service)
        return (NOBODY if len(asked) == 1 else BASE)[service]

    bus._values = values
    peers = (await bus.graph("/cmd_vel", ["/scan"]))["/cmd_vel"]
    assert peers.kinds or not peers.subscribers
    peers = (await bus.graph("/cmd_vel", ["/scan"]))["/cmd_vel"]
    assert (peers.kinds, peers.subscribers) == ({"geometry_msgs/TwistStamped"}, 1)
