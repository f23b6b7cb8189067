"""A latched pose comes before any odometry, a newer one right after it: the newer one counts."""

import asyncio

import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.ros import messages
from robots.api.geometry import Pose2D
from tests.support.virtual_time import on_virtual_time

STANDING = {"twist": {"linear": {"x": 0.0, "y": 0.0, "z": 0.0}, "angular": {"z": 0.0}}}


def fix(x, stamp):
    covariance = [0.0] * 36
    return {
        "header": messages.header("map", stamp, 1),
        "pose": {"pose": messages.pose(Pose2D(x, 1.0, 0.0)), "covariance": covariance},
    }


def odometry(stamp):
    pose = {"pose": messages.pose(Pose2D(0.0, 0.0, 0.0)), "covariance": [0.0] * 36}
    return {
        "header": messages.header("odom", stamp, 1),
        "child_frame_id": "base_link",
        "pose": pose,
        "twist": STANDING,
    }


@pytest.fixture
def adapter_and_topics():
    adapter = registry.create(
        "rosbridge", "rhodon", {"navigation": "none", "url": "ws://127.0.0.1:1", "version": "1"}
    )
    handlers = {each.topic: each.handler for each in adapter._subscriptions()}
    return adapter, handlers["/amcl_pose"], handlers["/odom"]


@on_virtual_time
async def test_a_reading_is_assembled_with_the_first_odometry(adapter_and_topics):
    adapter, hear_fix, hear_odometry = adapter_and_topics
    hear_fix(fix(5.0, 100.0))
    assert not adapter.readings.pose.localized
    hear_odometry(odometry(200.0))
    assert adapter.readings.pose.localized
    assert adapter.readings.pose.x == pytest.approx(5.0)


@pytest.mark.parametrize("order", ["both before", "one on each side"])
@on_virtual_time
async def test_the_newer_of_two_poses_counts_beside_the_first_odometry(adapter_and_topics, order):
    adapter, hear_fix, hear_odometry = adapter_and_topics
    hear_fix(fix(5.0, 100.0))
    if order == "both before":
        hear_fix(fix(2.0, 199.0))
        hear_odometry(odometry(200.0))
    else:
        hear_odometry(odometry(200.0))
        hear_fix(fix(2.0, 200.0))
        hear_odometry(odometry(200.1))
    await asyncio.sleep(1.0)
    assert adapter.readings.pose.x == pytest.approx(2.0)
