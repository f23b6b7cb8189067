"""Unknown keys of a profile are refused with the closest name; a profile states its watchdog."""

import dataclasses
import math

import msgspec
import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.simulator import adapter as simulator
from robots.agent.ramp import check_times
from robots.agent.robot_interface import AdapterError
from robots.api.messages import Limits

SPEEDS = {"linear": 0.5, "reverse": 0.2, "angular": 1.0}
SPEEDS |= {"linear_acceleration": 0.3, "angular_acceleration": 0.8}
SPEEDS |= {"linear_braking": 0.8, "angular_braking": 2.0}
LIMITS = Limits(**SPEEDS)
ROBOT = 'series = "mine"\nfootprint = [[0.2, -0.2], [0.2, 0.2], [-0.2, 0.0]]\n[limits]\n'
ROBOT += "".join(f"{name} = {value}\n" for name, value in SPEEDS.items())


def made(tmp_path, text, options=None, adapter="ros1"):
    file = tmp_path / "mine.toml"
    file.write_text(ROBOT + text)
    return registry.create(adapter, str(file), options)


def refusal(tmp_path, text, options=None):
    with pytest.raises(AdapterError) as caught:
        made(tmp_path, text, options)
    return str(caught.value)


STATED = "[ros1]\nwatchdog = 0.5\n"
BATTERY = "[battery]\nempty = 1\nfull = 2\n"


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        ("[Ros1]\n", "", "an unknown section [Ros1]; did you mean ros1?"),
        ("", "[ross]\nport = 1\n", "an unknown section [ross]; did you mean ros"),
        ("", "[batery]\nempty = 1\n", "an unknown section [batery]; did you mean battery?"),
        ("", 'cmd_vell = "/base"\n', "no option cmd_vell; did you mean cmd_vel?"),
        ("", 'Cmd_Vel = "/base"\n', "no option Cmd_Vel; did you mean cmd_vel?"),
        ("comand_age = 0.2\n", "", "[limits] has no key comand_age; did you mean command_age?"),
        ("commandAge = 0.2\n", "", "[limits] has no key commandAge; did you mean command_age?"),
        ("[laser]\nx = 0\nTheta = 0\n", "", "[laser] has no key Theta; did you mean theta?"),
        (BATTERY + "volts = 3\n", "", "[battery] has no key volts; there are empty, full"),
    ],
)
def test_an_unknown_name_is_refused_with_the_closest_one(tmp_path, before, after, sentence):
    assert sentence in refusal(tmp_path, before + STATED + after)


def test_an_unknown_option_is_refused_with_the_closest_one(tmp_path):
    refused = refusal(tmp_path, STATED, {"odometry": "/odom"})
    assert "no option odometry; did you mean odom?" in refused
    with pytest.raises(AdapterError, match="no option plann; did you mean plan"):
        registry.create("simulator", "giraff", {"plann": "clinic"})


def test_sections_of_other_adapters_are_ignored(tmp_path):
    assert made(tmp_path, STATED + "[moos]\nwatchdog = 0.5\n").profile.watchdog == 0.5


# --- the watchdog ---------------------------------------------------------------------------------


@pytest.mark.parametrize("adapter", ["moos", "openmora_mqtt", "ros1", "ros2", "rosbridge"])
def test_a_profile_must_state_the_watchdog_of_the_base(tmp_path, adapter):
    with pytest.raises(AdapterError, match=f"has no watchdog for {adapter}: set in its section"):
        made(tmp_path, "", adapter=adapter)
    controls = {"moos": "client_ack_interval = 0.5", "ros2": "on_robot = true"}
    controls["openmora_mqtt"] = controls["moos"]
    control = controls.get(adapter, 'navigation = "none"')
    stated = f"[{adapter}]\nwatchdog = 0.7\n{control}\n"
    assert made(tmp_path, stated, adapter=adapter).profile.watchdog == 0.7


def test_no_option_overrides_the_watchdog(tmp_path):
    refused = refusal(tmp_path, STATED, {"watchdog": "0.4"})
    assert "the watchdog is a property of the base" in refused


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
def test_a_watchdog_or_deadman_that_is_too_long_is_refused(watchdog, deadman, words):
    with pytest.raises(ValueError, match=words):
        check_times(watchdog, msgspec.structs.replace(LIMITS, deadman=deadman))


@pytest.mark.parametrize(("watchdog", "deadman"), [(2.0, 1.0), (0.3, 0.3), (1.0, 1.0)])
def test_times_at_their_bounds_are_accepted(watchdog, deadman):
    check_times(watchdog, msgspec.structs.replace(LIMITS, deadman=deadman))


def test_the_bounds_hold_for_files_and_for_an_adapters_own_profile(tmp_path, monkeypatch):
    assert "a watchdog of 30 s is too long" in refusal(tmp_path, "[ros1]\nwatchdog = 30\n")
    assert "a deadman of 1.5 s" in refusal(tmp_path, "deadman = 1.5\n[ros1]\nwatchdog = 1.8\n")
    profile = dataclasses.replace(registry.create("simulator", "giraff").profile, watchdog=30.0)
    monkeypatch.setattr(simulator, "profile_of", lambda *_, **__: profile)
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
