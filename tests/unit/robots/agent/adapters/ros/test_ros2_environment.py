"""The environment of ROS 2's node: which middleware, and how far it looks for others."""

from pathlib import Path

import pytest

from robots.agent.adapters.ros.ros2 import create

LOCAL = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
NAMES = (
    *("ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS"),
    *("RMW_IMPLEMENTATION", "FASTDDS_BUILTIN_TRANSPORTS"),
    *("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE"),
)


@pytest.fixture
def environment(monkeypatch):
    """Return those of NAMES that the node has where the agent has some."""

    def of(some):
        for name in NAMES:
            monkeypatch.delenv(name, raising=False)
        for name, value in some.items():
            monkeypatch.setenv(name, value)
        found = create("giraff", {"on_robot": "true"})._bus._environment
        return {name: found[name] for name in NAMES if name in found}

    return of


def profile_of(found):
    assert found["FASTDDS_DEFAULT_PROFILES_FILE"] == found["FASTRTPS_DEFAULT_PROFILES_FILE"]
    path = Path(found["FASTDDS_DEFAULT_PROFILES_FILE"])
    assert path.is_file()
    return path.stem


@pytest.mark.parametrize(
    "some",
    [{}, {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}, LOCAL | {"ROS_STATIC_PEERS": "192.0.2.7"}],
)
def test_fast_dds_uses_udp(environment, some):
    found = environment(some)
    assert profile_of(found) == "fastdds_udp"
    assert some.items() <= found.items()


@pytest.mark.parametrize("some", [LOCAL, {"ROS_LOCALHOST_ONLY": "1"}])
def test_fast_dds_on_one_computer_uses_only_local_udp(environment, some):
    found = environment(some)
    assert profile_of(found) == "fastdds_loopback"
    assert found["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SYSTEM_DEFAULT"
    assert "ROS_LOCALHOST_ONLY" not in found


@pytest.mark.parametrize(
    "some",
    [
        {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"},
        {"FASTDDS_BUILTIN_TRANSPORTS": "LARGE_DATA"},
        {"FASTRTPS_DEFAULT_PROFILES_FILE": "/etc/robot.xml"},
    ],
)
def test_another_middleware_or_a_users_own_profile_is_unchanged(environment, some):
    assert environment(some | LOCAL) == some | LOCAL
