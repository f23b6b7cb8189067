import json

import msgspec
import pytest

from experiments.definition.conditions import (
    Applied,
    allowed_actions,
    config,
    lease_limits,
    mismatches,
)
from experiments.definition.schema import Condition, Impairment, Network, SpeedChoice
from experiments.definition.shipped import shipped
from experiments.tasks.manipulation_check import as_stored
from robots.api import codec
from robots.api.messages import (
    AppliedCommand,
    Battery,
    LabReport,
    NetworkLab,
    Pose,
    State,
    Velocity,
)

CONDITION = Condition(
    key="hard",
    title={"en": "Hard"},
    robot="giraff",
    site="office",
    control_way="mqtt",
    controllers=("keyboard",),
    actions=("map", "dock"),
    assist="slow",
    speed=SpeedChoice(linear=0.4),
    doors_closed=("lab-door",),
    network=Network(control=Impairment(delay=0.3, loss=0.05)),
)
REPORT = LabReport(lab=NetworkLab(delay=0.3, loss=0.05, seed=11), taken=40, lost=2, held=0.3)


def state(*, assist="slow", control_network=REPORT, video_network=None, **command) -> State:
    fields = {"method": "keyboard", "way": "mqtt", "linear": 0.4, "angular": 0.0} | command
    return State(
        stamp=1.0,
        boot="b",
        seq=1,
        pose=Pose(x=0.0, y=0.0, theta=0.0),
        velocity=Velocity(linear=0.0, angular=0.0),
        battery=Battery(charge=1.0),
        assist=assist,
        applied=(AppliedCommand(seq=1, stamp=1.0, age=0.1, **fields),),
        control_network=control_network,
        video_network=video_network,
    )


def as_assigned() -> Applied:
    applied = Applied("giraff", "office", actions={"goto", "stop"}, doors_closed={"lab-door"})
    applied.see(state())
    return applied


def test_configuration_of_a_condition_names_the_state_of_every_door():
    message = config(CONDITION, ("lab-door", "lounge-door"), stamp=5.0, seed=11)
    assert message.doors == {"lab-door": "closed", "lounge-door": "open"}
    assert (message.assist, message.video_network) == ("slow", None)
    assert (message.control_network.delay, message.control_network.seed) == (0.3, 11)
    assert lease_limits(CONDITION).linear == 0.4
    assert codec.encode(message)


def test_only_the_actions_of_a_condition_are_allowed_and_stopping_always_is():
    allowed = allowed_actions(CONDITION)
    assert {"goto", "dock", "stop", "estop", "photo"} <= allowed
    assert not {"follow", "undock", "tilt"} & allowed
    assert "goto" not in allowed_actions(shipped()["exploration"].conditions[0])


def test_a_session_in_which_all_was_as_assigned_has_no_mismatch():
    assert mismatches(CONDITION, as_assigned()) == ()


@pytest.mark.parametrize(
    ("name", "spoil"),
    [
        ("robot", lambda a: setattr(a, "robot", "rhodon")),
        ("site", lambda a: setattr(a, "site", "clinic")),
        ("control_way", lambda a: a.see(state(way="datachannel"))),
        ("controllers", lambda a: a.see(state(method="touch"))),
        ("actions", lambda a: a.actions.add("undock")),
        ("assist", lambda a: a.see(state(assist="off"))),
        ("interface", lambda a: setattr(a, "interface", "fancy")),
        ("speed", lambda a: a.see(state(linear=-0.6))),
        ("doors_closed", lambda a: a.doors_closed.clear()),
        ("network", lambda a: a.see(state(control_network=None))),
        ("network", lambda a: a.see(state(control_network=LabReport(lab=NetworkLab(delay=0.2))))),
        ("network", lambda a: a.see(state(video_network=REPORT))),
    ],
)
def test_whatever_was_not_as_assigned_is_named(name, spoil):
    applied = as_assigned()
    spoil(applied)
    assert mismatches(CONDITION, applied) == (name,)


def test_an_impairment_that_changes_nothing_is_none():
    unimpaired = Network(control=Impairment(), video=Impairment())
    clean = msgspec.structs.replace(CONDITION, network=unimpaired)
    applied = Applied("giraff", "office", doors_closed={"lab-door"})
    applied.see(state(control_network=None))
    assert mismatches(clean, applied) == ()
    assert config(clean, (), stamp=5.0, seed=11).control_network is None


def test_the_robots_last_word_on_a_network_is_stored():
    applied = as_assigned()
    applied.see(state(control_network=LabReport(lab=REPORT.lab, taken=90, lost=4)))
    stored = as_stored(applied)
    assert stored["control_network"]["taken"] == 90
    assert "video_network" not in stored
    assert json.loads(json.dumps(stored)) == stored
