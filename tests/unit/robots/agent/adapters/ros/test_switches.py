"""The bumper and the emergency button of a robot with ROS: std_msgs/Bool through the adapter."""

import pytest

from robots.agent.adapters import registry

MALFORMED = [{}, {"data": None}, {"data": 0}, {"data": "false"}]


@pytest.fixture
def adapter():
    options = {"navigation": "none", "bumper": "bumper", "estop": "button"}
    return registry.create("rosbridge", "rhodon", options | {"url": "ws://127.0.0.1:1"})


def sender(adapter, topic):
    """Return a function that gives the adapter a message of a topic, as its bus does."""
    found = next(each for each in adapter._subscriptions() if each.topic == topic)
    return adapter._safely(found.topic, found.handler)


def contacts(adapter):
    return adapter.readings.state(0.0).contacts


def test_each_touch_of_the_bumper_counts_one_contact(adapter):
    send, counted = sender(adapter, "/bumper"), []
    for touching in (False, True, True, False, True):
        send({"data": touching})
        counted.append(contacts(adapter))
    assert counted == [0, 1, 1, 1, 2]


@pytest.mark.parametrize("message", MALFORMED)
def test_malformed_message_of_the_bumper_does_not_end_a_contact(adapter, message):
    send = sender(adapter, "/bumper")
    for each in ({"data": True}, message, {"data": True}):
        send(each)
    assert contacts(adapter) == 1


@pytest.mark.parametrize("message", MALFORMED)
def test_malformed_message_of_the_emergency_button_does_not_release_it(adapter, message):
    send = sender(adapter, "/button")
    send({"data": True})
    send(message)
    assert adapter.readings.estop is True
