"""What a study asks of robots that none of them can do."""

from experiments.definition.feasibility import NETWORK_LAB, Known, RobotFacts, obstacles
from surveys.document_forms.problem_text import sentences
from tests.support.studies.studies import STUDY, cabin, small_study


def found(network: dict[str, dict[str, float]], *capabilities: str) -> list[str]:
    study = small_study(conditions=[{**STUDY["conditions"][0], "network": network}])
    giraff = RobotFacts(frozenset(("velocity", *capabilities)), 0.7)
    return sentences(
        obstacles(study, Known({"cabin": cabin()}, {"giraff": giraff}, QUESTIONNAIRES))
    )


def test_a_network_that_the_robot_cannot_make_worse_is_refused():
    slow = {"control": {"delay": 0.1}}
    assert found(slow) == [
        "Condition all_open: giraff cannot impair its network: remove the delay, loss or limit."
    ]
    assert found(slow, NETWORK_LAB) == []


def test_a_delay_that_slows_the_robot_is_refused_with_the_remaining_speed():
    assert found({"control": {"delay": 0.1}}, NETWORK_LAB) == []
    assert found({"control": {"delay": 0.2}}, NETWORK_LAB) == [
        (
            "Condition all_open: commands would arrive up to 215 ms late, and giraff slows down"
            " when they are older than 125 ms: it would drive at about 0.20 m/s instead of 0.70"
            " m/s. The condition would measure the safety limits as well as delay. Delay the video"
            " instead (up to 440 ms), which delays what the driver sees and does, and no command."
        )
    ]
    assert "refuse" not in str(found({"control": {"delay": 0.17, "jitter": 0.03}}, NETWORK_LAB))


def test_the_speed_that_is_left_is_of_the_conditions_own_limit_which_falls_with_it():
    slow = {**STUDY["conditions"][0], "network": {"control": {"delay": 0.2}}}
    study = small_study(conditions=[slow | {"speed": {"linear": 0.3}}])
    giraff = RobotFacts(frozenset(("velocity", NETWORK_LAB)), 0.7)
    known = Known({"cabin": cabin()}, {"giraff": giraff}, QUESTIONNAIRES)
    (sentence,) = sentences(obstacles(study, known))
    assert "at about 0.08 m/s instead of 0.30 m/s" in sentence


def test_a_speed_limit_that_the_robot_never_reaches_is_refused_with_the_robots_own():
    def speed_problems(**speed: float) -> list[str]:
        study = small_study(conditions=[{**STUDY["conditions"][0], "speed": speed}])
        giraff = RobotFacts(frozenset(("velocity",)), 0.7, angular=1.2)
        known = Known({"cabin": cabin()}, {"giraff": giraff}, QUESTIONNAIRES)
        return sentences(obstacles(study, known))

    assert speed_problems(linear=9.0, angular=1.3) == [
        (
            "Condition all_open: the speed limit of 9 m/s is above the top speed of giraff,"
            " 0.7 m/s: lower it, or leave it blank to use the robot's."
        ),
        (
            "Condition all_open: the limit of the turning speed of 74.48 °/s is above the top"
            " speed of giraff, 68.75 °/s: lower it, or leave it blank to use the robot's."
        ),
    ]
    assert speed_problems(linear=0.7, angular=1.2) == []


def test_video_delay_is_limited_to_the_bound_in_the_sentence():
    assert found({"video": {"delay": 0.44}}, NETWORK_LAB) == []
    assert found({"video": {"delay": 0.3, "jitter": 0.05, "loss": 0.02}}, NETWORK_LAB) == []
    (sentence,) = found({"video": {"delay": 0.6}}, NETWORK_LAB)
    assert "would be up to 660 ms late, and giraff slows down when they are older than 500" in (
        sentence
    )
    assert "at about 0.48 m/s instead of 0.70 m/s" in sentence


def test_a_delay_that_makes_every_command_too_old_is_refused():
    assert found({"control": {"delay": 0.25, "jitter": 0.05}}, NETWORK_LAB) == [
        (
            "Condition all_open: commands would be delayed by up to 300 ms; giraff accepts none"
            " older than 250 ms, and 50 ms of that are reserved for the real network."
        )
    ]


def test_a_delay_that_makes_every_picture_too_old_is_refused():
    assert (
        "accepts no command based on video older than 1000 ms"
        in found({"video": {"delay": 0.9}}, NETWORK_LAB)[0]
    )


QUESTIONNAIRES = frozenset({("experience", 1)})
