"""Every key of a profile is used, or refused with the closest name, and has a watchdog."""

import math

import pytest

from robots.agent.adapters import registry
from robots.agent.ramp import check_times
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Limits

ROBOT = """
series = "mine"
footprint = [[0.2, -0.2], [0.2, 0.2], [-0.2, 0.0]]
[limits]
linear = 0.5
reverse = 0.2
angular = 1.0
linear_acceleration = 0.3
angular_acceleration = 0.8
linear_braking = 0.8
angular_braking = 2.0
"""
LIMITS = Limits(
    linear=0.5,
    reverse=0.2,
    angular=1.0,
    linear_acceleration=0.3,
    angular_acceleration=0.8,
    linear_braking=0.8,
    angular_braking=2.0,
)


def made(tmp_path, text, options=None, adapter="ros1"):
    file = tmp_path / "mine.toml"
    file.write_text(ROBOT + text)
    return registry.create(adapter, str(file), options)


def refusal(tmp_path, text, options=None):
    with pytest.raises(AdapterError) as caught:
        made(tmp_path, text, options)
    return str(caught.value)


STATED = "[ros1]\nwatchdog = 0.5\n"


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[Ros1]\nwatchdog = 0.5\n", "an unknown section [Ros1]; did you mean ros1?"),
        (STATED + "[ross]\nport = 1\n", "an unknown section [ross]; did you mean ros"),
        (
            STATED + "[batery]\nempty = 1.0\n",
            "an unknown section [batery]; did you mean battery?",
        ),
        (
            '[ros1]\nwatchdog = 0.5\ncmd_vell = "/base"\n',
            "no option cmd_vell; did you mean cmd_vel?",
        ),
        ('[ros1]\nwatchdog = 0.5\nCmd_Vel = "/base"\n', "no option Cmd_Vel; did you mean cmd_vel?"),
        (
            "comand_age = 0.2\n" + STATED,
            "[limits] has no key comand_age; did you mean command_age?",
        ),
        (
            "commandAge = 0.2\n" + STATED,
            "[limits] has no key commandAge; did you mean command_age?",
        ),
        (
            "[laser]\nx = 0.1\nTheta = 0.0\n" + STATED,
            "[laser] has no key Theta; did you mean theta?",
        ),
        (
            "[battery]\nempty = 1.0\nfull = 2.0\nvolts = 3.0\n" + STATED,
            "[battery] has no key volts; there are empty, full",
        ),
    ],
)
def test_a_name_that_nobody_knows_is_refused_with_the_one_that_was_meant(tmp_path, text, sentence):
    assert sentence in refusal(tmp_path, text)


def test_an_option_that_nobody_knows_is_refused_with_the_one_that_was_meant(tmp_path):
    assert "no option odometry; did you mean odom?" in refusal(
        tmp_path, STATED, {"odometry": "/odom"}
    )
    with pytest.raises(AdapterError, match="no option plann; did you mean plan"):
        registry.create("simulator", "giraff", {"plann": "clinic"})


def test_sections_of_other_adapters_are_no_business_of_this_one(tmp_path):
    assert made(tmp_path, STATED + "[moos]\nwatchdog = 0.5\n").profile.watchdog == 0.5


# --- the watchdog ---------------------------------------------------------------------------------


@pytest.mark.parametrize("adapter", ["moos", "openmora_mqtt", "ros1", "ros2", "rosbridge"])
def test_a_profile_that_states_no_watchdog_is_refused_for_no_default_is_a_property_of_the_base(
    tmp_path, adapter
):
    with pytest.raises(AdapterError, match=f"has no watchdog for {adapter}: set in its section"):
        made(tmp_path, "", adapter=adapter)
    controls = {"moos": "client_ack_interval = 0.5", "ros2": "on_robot = true"}
    controls["openmora_mqtt"] = controls["moos"]
    control = controls.get(adapter, 'navigation = "none"')
    stated = f"[{adapter}]\nwatchdog = 0.7\n{control}\n"
    assert made(tmp_path, stated, adapter=adapter).profile.watchdog == 0.7


def test_no_option_overrules_it(tmp_path):
    assert "the watchdog is a property of the base" in refusal(
        tmp_path, STATED, {"watchdog": "0.4"}
    )


@pytest.mark.parametrize(
    ("watchdog", "deadman", "words"),
    [
        (30.0, 0.3, "a watchdog of 30 s is too long"),
        (2.01, 0.3, "too long"),
        (math.inf, 0.3, "too long"),
        (math.nan, 0.3, "too long"),
        (0.2, 0.3, "shorter than the deadman"),
        (0.0, 0.3, "shorter than the deadman"),
        (2.0, 1.1, "a deadman of 1.1 s is too long"),
    ],
)
def test_times_that_would_let_a_robot_go_on_are_refused(watchdog, deadman, words):
    import msgspec

    with pytest.raises(ValueError, match=words):
        check_times(watchdog, msgspec.structs.replace(LIMITS, deadman=deadman))


@pytest.mark.parametrize(("watchdog", "deadman"), [(2.0, 1.0), (0.3, 0.3), (1.0, 1.0)])
def test_times_at_their_bounds_are_taken(watchdog, deadman):
    import msgspec

    check_times(watchdog, msgspec.structs.replace(LIMITS, deadman=deadman))


def test_the_bounds_hold_for_a_profile_and_for_an_adapter_with_a_profile_of_its_own(
    tmp_path, monkeypatch
):
    import dataclasses

    from robots.agent.adapters.simulator import adapter as simulator

    assert "a watchdog of 30 s is too long" in refusal(tmp_path, "[ros1]\nwatchdog = 30\n")
    assert "a deadman of 1.5 s" in refusal(tmp_path, "deadman = 1.5\n[ros1]\nwatchdog = 1.8\n")
    original = simulator.profile_of
    monkeypatch.setattr(
        simulator,
        "profile_of",
        lambda *a, **k: dataclasses.replace(original(*a, **k), watchdog=30.0),
    )
    with pytest.raises(AdapterError, match="a watchdog of 30 s is too long"):
        registry.create("simulator", "giraff")


# --- the guard of OpenMORA's navigation -----------------------------------------------------------


@pytest.mark.parametrize("adapter", ["moos", "openmora_mqtt"])
@pytest.mark.parametrize("interval", [None, 0, 2.5])
def test_openmora_without_a_guard_is_refused_unless_its_profile_allows_it(
    tmp_path, adapter, interval
):
    stated = f"[{adapter}]\nwatchdog = 0.7\n"
    stated += "" if interval is None else f"client_ack_interval = {interval}\n"
    with pytest.raises(AdapterError, match=r"max_client_ack_interval = 0\.5 for"):
        made(tmp_path, stated, adapter=adapter)
    file = tmp_path / "mine.toml"
    file.write_text("unguarded_navigation = true\n" + ROBOT + stated)
    assert registry.create(adapter, str(file)).profile.navigation_control == "unguarded"


@pytest.mark.parametrize("adapter", ["moos", "openmora_mqtt"])
def test_openmora_is_guarded_by_its_acknowledgements(tmp_path, adapter):
    stated = f"[{adapter}]\nwatchdog = 0.7\nclient_ack_interval = 0.5\n"
    assert made(tmp_path, stated, adapter=adapter).profile.navigation_control == "guarded"
