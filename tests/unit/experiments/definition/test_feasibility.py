"""What a study asks of robots that none of them can do."""

from experiments.definition.feasibility import NETWORK_LAB, Known, RobotFacts, obstacles
from experiments.definition.reachability import unreachable
from tests.support.studies import STUDY, cabin, small_study


def found(network: dict[str, dict[str, float]], *capabilities: str) -> list[str]:
    study = small_study(conditions=[{**STUDY["conditions"][0], "network": network}])
    giraff = RobotFacts(frozenset(("velocity", *capabilities)), 0.7)
    return list(
        obstacles(study, Known({"cabin": cabin()}, {"giraff": giraff}, QUESTIONNAIRES), unreachable)
    )


def test_a_network_that_the_robot_cannot_make_worse_is_refused():
    slow = {"control": {"delay": 0.15}}
    assert found(slow) == [
        "Condition all_open: giraff cannot impair its network: remove the delay, loss or limit."
    ]
    assert found(slow, NETWORK_LAB) == []


def test_a_delay_that_makes_every_command_too_old_is_refused():
    assert found({"control": {"delay": 0.17, "jitter": 0.03}}, NETWORK_LAB) == []
    assert found({"control": {"delay": 0.25, "jitter": 0.05}}, NETWORK_LAB) == [
        (
            "Condition all_open: commands would be delayed by up to 300 ms; giraff accepts none"
            " older than 250 ms, and 50 ms of that are reserved for the real network."
        )
    ]


def test_a_delay_that_makes_every_picture_too_old_is_refused():
    assert (
        found({"video": {"delay": 0.6, "jitter": 0.05}, "control": {"delay": 0.2}}, NETWORK_LAB)
        == []
    )
    assert (
        "accepts no command based on video older than 1000 ms"
        in found({"video": {"delay": 0.9}}, NETWORK_LAB)[0]
    )


QUESTIONNAIRES = frozenset({("experience", 1)})
