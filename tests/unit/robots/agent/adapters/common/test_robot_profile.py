"""Robots' profiles: the paper's two, an owner's own, and the sentence for each mistake."""

import dataclasses
import math
import re
import sys
import tomllib

import msgspec
import pytest

from robots.agent.adapters import registry
from robots.agent.adapters.common.remote_adapter import profile_of
from robots.agent.adapters.common.robot_profile import load_profile
from robots.agent.adapters.simulator import adapter as simulator
from robots.agent.config import load
from robots.agent.ramp import check_times
from robots.agent.robot_interface import AdapterError, DepthCamera, Sonar
from robots.agent.safety.obstacle_sources import sources_of
from robots.api.adapter_names import PROFILES
from robots.world.robot_models import GIRAFF
from tests.support.paths import ROOT

MINE = 'series = "mine"\nfootprint = [[0.2, -0.2], [0.2, 0.2], [-0.2, 0.0]]\n[limits]\n'
LIMITS = (
    "linear = 0.5\nreverse = 0.2\nangular = 1.0\nlinear_acceleration = 0.3\nangular_acceleration ="
    " 0.8\nlinear_braking = 0.8\nangular_braking = 2.0\n"
)
REAL = ("moos", "openmora_mqtt", "ros1", "ros2", "rosbridge")
# what stops the robot's own navigation when the agent is lost
SAFE = {"ros2": {"on_robot": "true"}, "rosbridge": {"navigation_velocity": "cmd_vel_nav"}}


def arguments(robot, **given):
    return load({"robot": robot, "mqtt_url": "mqtt://127.0.0.1", **given}, {})


@pytest.mark.parametrize("adapter", REAL)
@pytest.mark.parametrize("robot", sorted(path.stem for path in PROFILES.glob("*.toml")))
def test_each_of_the_papers_robots_works_with_each_architecture(robot, adapter):
    profile = registry.create(adapter, robot, SAFE.get(adapter)).profile
    assert profile.series == robot
    assert profile.watchdog > 0.0
    assert ("tilt" in profile.capabilities) <= (robot == "giraff")


def test_the_command_line_of_the_paper_is_enough():
    config = arguments("giraff", adapter="moos", option=["host=10.0.0.5"])
    adapter = registry.create(config.adapter, config.profile, config.options)
    assert adapter.place == "the MOOSDB at 10.0.0.5:9000"
    assert adapter.profile.rca == "MOOS (OpenMORA)"
    assert {"localization", "goto", "dock", "undock", "tilt"} <= set(adapter.profile.capabilities)
    config = arguments("rhodon", adapter="ros1")
    assert registry.create(config.adapter, config.profile, config.options).profile.rca == "ROS 1"


def test_a_profile_overrides_defaults_and_options_override_it(tmp_path):
    file = tmp_path / "mine.toml"
    options = 'watchdog = 0.5\nclient_ack_interval = 0.5\nport = 9001\nhost = "robot"\n'
    file.write_text(f"{MINE}{LIMITS}[moos]\n{options}")
    assert registry.create("moos", str(file)).place == "the MOOSDB at robot:9001"
    assert registry.create("moos", str(file), {"port": "9002"}).place == "the MOOSDB at robot:9002"


SONAR = "[[sonars]]\nx = 0.2\ny = 0.0\ntheta = 0.0\nwidth = 0.4\n"


def profile_file(tmp_path, *, top="", sections="", adapter="ros1", options=""):
    file = tmp_path / "mine.toml"
    own = f"[{adapter}]\nwatchdog = 0.5\n{options}"
    file.write_text(MINE.replace("[limits]", top + "[limits]") + LIMITS + sections + own)
    return str(file)


def test_each_obstacle_sensor_of_a_profile_is_a_source_of_the_monitor(tmp_path):
    file = profile_file(tmp_path, top="bumper = true\n", sections=SONAR + "[depth]\n")
    profile = profile_of(load_profile(file), "Rosie", 0.5, sensors=("sonars", "bumper", "depth"))
    assert profile.sonars == (Sonar(0.2, 0.0, 0.0, width=0.4),)
    assert (profile.bumper, profile.depth) == (True, DepthCamera())
    assert len(sources_of(profile)) == 3


@pytest.mark.parametrize("adapter", REAL)
@pytest.mark.parametrize(
    ("top", "sections", "sentence"),
    [
        ("bumper = true\n", "", "mine.toml: line 3: bumper = true cannot be used with"),
        ("", SONAR, "mine.toml: line 11: [[sonars]] cannot be used with"),
        ("", "[depth]\n", "mine.toml: line 11: [depth] cannot be used with"),
    ],
)
def test_a_sensor_that_the_adapter_does_not_deliver_is_refused_with_its_line(
    tmp_path, adapter, top, sections, sentence
):
    file = profile_file(tmp_path, top=top, sections=sections, adapter=adapter)
    with pytest.raises(AdapterError) as caught:
        registry.create(adapter, file)
    assert sentence in str(caught.value)
    assert "remove" in str(caught.value)


def test_a_topic_of_a_bumper_without_directions_needs_no_bumper_in_the_profile(tmp_path):
    file = profile_file(tmp_path, options='bumper = "bumper"\n')
    assert not registry.create("ros1", file).profile.bumper


def test_standstill_thresholds_have_defaults(tmp_path):
    file = profile_file(tmp_path, top="standstill_linear = 0.04\nstandstill_angular = 0.12\n")
    noisy = registry.create("ros1", file).profile
    assert (noisy.standstill_linear, noisy.standstill_angular) == (0.04, 0.12)
    usual = registry.create("ros1", "giraff").profile
    assert (usual.standstill_linear, usual.standstill_angular) == (0.02, 0.05)


def test_a_base_without_localization_gets_ours():
    adapter = registry.autonomous(registry.create("ros2", "rhodon", {"localization": "none"}))
    assert {"goto", "dock", "undock", "relocalize"} <= set(adapter.profile.capabilities)


WHOLE = (
    f"bumper = true\n{MINE}{LIMITS}[camera]\nwidth = 64\nheight = 48\nfps = 5\nhfov = 1.5\nx = 0\n"
    "z = 1\n[battery]\nempty = 20\nfull = 30\n"
    "[[sonars]]\nx = 0.2\ny = 0\ntheta = 0\n[[sonars]]\nx = 0.2\ny = 1\ntheta = 1\n"
    "[moos]\nwatchdog = 0.5\nclient_ack_interval = 0.5\nport = 9000\n"
)
END = "port = 9000\n"


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        # values that are missing or out of their range
        (WHOLE, "series = ", "cannot be used"),
        ("linear = 0.5\n", "", "line 4: [limits] has no linear"),
        ("linear = 0.5", "linear = 50", "linear is 50; it cannot be more than 5"),
        ("linear = 0.5", "linear = -1", "line 5: [limits] linear must be a number above 0, not -1"),
        ('series = "mine"\n', "", "the file has no series"),
        ("0.2, -0.2", "0.2", "footprint"),
        ("empty = 20", "empty = 40", "fewer volts"),
        ("theta = 1\n", "", "line 26: sonars number 2 has no theta"),
        (END, "[tilt]\nminimum = 0.0\n", "maximum"),
        ("bumper = true", "standstill_linear = 0.2", "at most 0.1, not 0.2"),
        ("bumper = true", "standstill_angular = 0", "a number above 0, not 0"),
        ("bumper = true", "standstill_angular = 0.31", "at most 0.3"),
        # values of the wrong type, with the right one
        ("linear = 0.5", "linear = 0,5", "line 5: linear must be a number, not 0,5: write 0.5"),
        ("linear = 0.5", "linear = .5", "line 5: linear must be a number, not .5: write 0.5"),
        ("linear = 0.5", "linear = 5 m/s", "line 5, 'linear = 5 m/s': Expected newline"),
        (
            "linear = 0.5",
            'linear = "0.5"',
            "[limits] linear must be a number, not '0.5': write 0.5",
        ),
        ("linear = 0.5", "linear = true", "line 5: [limits] linear must be a number, not true"),
        (
            "linear_braking = 0.8",
            'linear_braking = "-0,8"',
            "line 10: [limits] linear_braking must be a number, not '-0,8': write -0.8",
        ),
        ('series = "mine"', "series = 3", "line 2: series must be a text in quotes, not 3"),
        ("[0.2, -0.2]", "[0,2, -0.2]", "line 3: footprint number 1 must be 2 numbers, not [0, 2, "),
        ("width = 64", "width = 64.5", "[camera] width must be a whole number, not 64.5"),
        ("width = 64", 'width = "64"', "[camera] width must be a whole number, not '64': write 64"),
        ("width = 64", 'width = "6,4"', "[camera] width must be a whole number, not '6,4'"),
        ("empty = 20", 'empty = "20"', "[battery] empty must be a number, not '20': write 20"),
        ("y = 1", "y = '1'", "line 28: [[sonars]] number 2, y, must be a number, not '1': write 1"),
        ("bumper = true", "bumper = 'yes'", "bumper must be true or false, not 'yes'"),
        (
            "watchdog = 0.5",
            'watchdog = "0,5"',
            "[moos] watchdog must be a number, not '0,5': write",
        ),
        (END, 'port = "x"', "[moos] port must be a whole number from 1 to 65535, not"),
        # unknown names, with the closest known one
        ("bumper = true", 'colour = "red"', "colour is not a key of a robot profile"),
        ("[camera]", "comand_age = 0.2\n[camera]", "[limits] has no key comand_age; did you mean"),
        ("[camera]", "commandAge = 0.2\n[camera]", "did you mean command_age?"),
        (END, "[laser]\nx = 0\nTheta = 0\n", "[laser] has no key Theta; did you mean theta?"),
        (
            "empty = 20",
            "volts = 3\nempty = 20",
            "[battery] has no key volts; there are empty, full",
        ),
        ("theta = 1\n", "theta = 1\nwide = 1.0\n", "wide"),
        (END, "[depth]\nheight = 1.0\n", "height"),
    ],
)
def test_a_mistake_in_a_profile_is_named_with_its_file_place_and_remedy(
    tmp_path, before, after, sentence
):
    refused = refusal_of_changed(tmp_path, before, after)
    assert sentence in refused
    assert refused.startswith(f"the robot profile {tmp_path / 'mine.toml'}")


@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        ("watchdog = 0.5", "watchdog = 0.0", "watchdog"),
        ("[moos]\n", "[Moos]\n[moos]\n", "an unknown section [Moos]; did you mean moos?"),
        (END, "[ross]\nport = 1\n", "an unknown section [ross]; did you mean ros"),
        ("[battery]", "[batery]", "an unknown section [batery]; did you mean battery?"),
        (END, "prt = 1\n", "no option prt; did you mean port?"),
        (END, "Port = 1\n", "no option Port; did you mean port?"),
    ],
)
def test_a_wrong_option_or_section_of_a_profile_is_named(tmp_path, before, after, sentence):
    assert sentence in refusal_of_changed(tmp_path, before, after)


def refusal_of_changed(tmp_path, before, after):
    """Return why a profile with a change is refused."""
    file = tmp_path / "mine.toml"
    file.write_text(WHOLE)
    load_profile(str(file))
    assert before in WHOLE
    file.write_text(WHOLE.replace(before, after, 1))
    with pytest.raises(AdapterError) as error:
        registry.create("moos", str(file))
    assert "\n" not in str(error.value)
    return str(error.value)


def test_the_error_of_a_missing_profile_lists_the_existing_ones():
    with pytest.raises(AdapterError, match="choose one of giraff, rhodon"):
        load_profile("r2d2")
    with pytest.raises(AdapterError, match=r"there is no file \./r2d2\.toml"):
        load_profile("./r2d2.toml")


@pytest.mark.parametrize(
    ("adapter", "option", "value", "sentence"),
    [
        ("moos", "port", "many", "port must be a whole number from 1 to 65535, not 'many'"),
        ("moos", "port", "99999", "port must be a whole number from 1 to 65535, not '99999'$"),
        ("moos", "tilt_sign", "up", "tilt_sign must be a number, not 'up'$"),
        ("moos", "tilt_sign", "0,5", "tilt_sign must be a number, not '0,5': write 0.5$"),
        ("openmora_mqtt", "broker", "robot:1883", "the broker's address must be mqtt://"),
        ("openmora_mqtt", "broker", "mqtt://robot:x", "the port must be from 1 to 65535"),
        ("ros1", "localization", "gps", "localization must be one of none, pose, tf, not 'gps'"),
        ("ros1", "stamped", "maybe", "stamped must be auto, true or false, not 'maybe'"),
        ("ros1", "cmd_vel", "cmd vel", "cmd_vel must be a name of ROS .* not 'cmd vel'"),
        ("ros2", "namespace", "robot 1", "namespace must be .* such as /robot1, not 'robot 1'"),
        ("ros2", "domain", "many", "domain must be a whole number from 0 to 232, not 'many'"),
        ("ros2", "domain", "233", "domain must be a whole number from 0 to 232, not '233'"),
        ("rosbridge", "url", "robot:9090", "url must be the address of rosbridge, such as ws://"),
        ("rosbridge", "url", "ws://robot:x", "url must be the address of rosbridge"),
        ("rosbridge", "version", "3", "version must be a whole number from 1 to 2, not '3'"),
        ("simulator", "seed", "x", "the simulator's option seed must be a whole number, not 'x'"),
        ("simulator", "start", "nowhere", "nowhere"),
        ("simulator", "plan", "castle", "office"),
    ],
)
def test_a_malformed_option_is_refused_with_its_rule(adapter, option, value, sentence):
    with pytest.raises(AdapterError, match=sentence) as error:
        registry.create(adapter, "giraff", {option: value})
    assert "\n" not in str(error.value)


def test_the_error_of_a_missing_site_names_its_option():
    adapter = registry.create("ros2", "rhodon", {"localization": "none"})
    with pytest.raises(AdapterError, match="--plan: no site 'nowhere': give one of "):
        registry.autonomous(adapter, "nowhere")


# --- options, the watchdog, and the guard of OpenMORA's navigation --------------------------------

STATED = "[ros1]\nwatchdog = 0.5\n"


def made(tmp_path, text, options=None, adapter="ros1", top=""):
    file = tmp_path / "mine.toml"
    file.write_text(top + MINE + LIMITS + text)
    return registry.create(adapter, str(file), options)


def refusal(tmp_path, text, options=None):
    with pytest.raises(AdapterError) as caught:
        made(tmp_path, text, options)
    return str(caught.value)


def test_an_unknown_option_is_refused_with_the_closest_one(tmp_path):
    refused = refusal(tmp_path, STATED, {"odometry": "/odom"})
    assert "no option odometry; did you mean odom?" in refused
    with pytest.raises(AdapterError, match="no option plann; did you mean plan"):
        registry.create("simulator", "giraff", {"plann": "clinic"})


def test_sections_of_other_adapters_are_ignored(tmp_path):
    assert made(tmp_path, STATED + "[moos]\nwatchdog = 0.5\n").profile.watchdog == 0.5


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
        check_times(watchdog, msgspec.structs.replace(GIRAFF.limits, deadman=deadman))


@pytest.mark.parametrize(("watchdog", "deadman"), [(2.0, 1.0), (0.3, 0.3), (1.0, 1.0)])
def test_times_at_their_bounds_are_accepted(watchdog, deadman):
    check_times(watchdog, msgspec.structs.replace(GIRAFF.limits, deadman=deadman))


def test_the_bounds_hold_for_files_and_for_an_adapters_own_profile(tmp_path, monkeypatch):
    assert "a watchdog of 30 s is too long" in refusal(tmp_path, "[ros1]\nwatchdog = 30\n")
    assert "a deadman of 1.5 s" in refusal(tmp_path, "deadman = 1.5\n[ros1]\nwatchdog = 1.8\n")
    profile = dataclasses.replace(registry.create("simulator", "giraff").profile, watchdog=30.0)
    monkeypatch.setattr(simulator, "profile_of", lambda *_, **__: profile)
    with pytest.raises(AdapterError, match="a watchdog of 30 s is too long"):
        registry.create("simulator", "giraff")


@pytest.mark.parametrize("adapter", ["moos", "openmora_mqtt"])
@pytest.mark.parametrize("interval", [None, 0, 2.5])
def test_openmora_without_a_guard_is_refused_unless_its_profile_allows_it(
    tmp_path, adapter, interval
):
    stated = f"[{adapter}]\nwatchdog = 0.7\n"
    stated += "" if interval is None else f"client_ack_interval = {interval}\n"
    with pytest.raises(AdapterError, match=r"max_client_ack_interval = 0\.5 for"):
        made(tmp_path, stated, adapter=adapter)
    allowed = made(tmp_path, stated, adapter=adapter, top="unguarded_navigation = true\n")
    assert allowed.profile.navigation_control == "unguarded"


@pytest.mark.parametrize("adapter", ["moos", "openmora_mqtt"])
def test_openmora_is_guarded_by_its_acknowledgements(tmp_path, adapter):
    stated = f"[{adapter}]\nwatchdog = 0.7\nclient_ack_interval = 0.5\n"
    assert made(tmp_path, stated, adapter=adapter).profile.navigation_control == "guarded"
