"""How the names of topics, services and actions follow from the options, as in ROS."""

import pytest

from robots.agent.adapters.ros.base import NAMED, RosOptions


@pytest.mark.parametrize("namespace", ["", "/"])
def test_without_a_namespace_names_begin_at_the_root(namespace):
    options = RosOptions(watchdog=0.5, namespace=namespace, dock="dock").resolved()
    assert (options.cmd_vel, options.tf, options.dock) == ("/cmd_vel", "/tf", "/dock")
    assert options.bumper == "", "an empty name is one that the robot does not have"


@pytest.mark.parametrize("namespace", ["robot1", "/robot1", "/robot1/"])
def test_all_names_are_below_the_namespace_but_those_that_begin_with_a_slash(namespace):
    given = dict.fromkeys(NAMED, "a/name") | {"tf": "/tf"}
    options = RosOptions(watchdog=0.5, namespace=namespace, **given).resolved()
    found = {option: getattr(options, option) for option in NAMED}
    assert found == dict.fromkeys(NAMED, "/robot1/a/name") | {"tf": "/tf"}
    assert (options.map_frame, options.odom_frame) == ("map", "odom"), "frames have no namespace"


def test_option_that_is_not_declared_a_name_is_taken_as_it_is():
    class WithType(RosOptions, frozen=True, kw_only=True):
        bumper_type: str = "std_msgs/Bool"

    options = WithType(watchdog=0.5, namespace="robot1", tilt_joint="head joint").resolved()
    assert (options.tilt_joint, options.bumper_type) == ("head joint", "std_msgs/Bool")


def test_a_namespace_may_be_nested_and_holds_for_every_default():
    options = RosOptions(watchdog=0.5, namespace="site/robot1").resolved()
    defaults = [getattr(options, option) for option in NAMED if getattr(options, option)]
    assert len(defaults) > 8
    assert all(name.startswith("/site/robot1/") for name in defaults)
