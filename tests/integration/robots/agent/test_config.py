"""An agent's settings, and the sentence that reports a missing or invalid one."""

import argparse
import random
import shlex

import pytest

from robots.agent.agent import Agent
from robots.agent.broker_link.broker_discovery import broker_urls
from robots.agent.config import ConfigError, add_arguments, load
from robots.agent.lab.in_force import CLEAN
from robots.agent.timing import Backoff
from robots.api.messages import NetworkLab
from tests.support.agents.agent_server import AgentServer


def loaded(line, environment=None):
    """Return the settings of a command line and environment."""
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    return load(vars(parser.parse_args(shlex.split(line))), environment or {})


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path, monkeypatch):
    """Where a demo has run, there are credentials in `var`."""
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def credentials(tmp_path):
    file = tmp_path / "giraff.toml"
    file.write_text(
        'robot = "giraff"\ntoken = "from-file"\nserver = "https://file.example"\nviewers ='
        ' 3\nadapter = "moos"\n[options]\nseed = 7\n'
    )
    return file


def test_credentials_file_contains_all_settings(credentials):
    config = loaded(f"giraff --credentials {credentials}")
    assert (config.server, config.mqtt_url, config.token, config.viewers) == (
        "https://file.example",
        None,
        "from-file",
        3,
    )
    assert (config.adapter, config.profile, config.options) == ("moos", "giraff", {"seed": 7})


def test_command_line_overrides_environment_and_environment_overrides_file(credentials):
    environment = {
        "TELEPRESENCE_CREDENTIALS": str(credentials),
        "TELEPRESENCE_SERVER": "https://env.example",
        "TELEPRESENCE_VIEWERS": "5",
    }
    config = loaded("giraff", environment)
    assert (config.server, config.viewers) == ("https://env.example", 5)
    line = "giraff --server https://line.example/ --option seed=8 --option plan=office"
    config = loaded(line, environment)
    assert config.server == "https://line.example"
    assert config.options == {"seed": "8", "plan": "office"}


def test_name_is_enough_on_the_servers_machine(tmp_path):
    (tmp_path / "credentials").mkdir()
    (tmp_path / "credentials" / "giraff.toml").write_text(
        'robot = "giraff"\ntoken = "t"\nmqtt_url = "mqtt://127.0.0.1:1883"\n'
    )
    config = loaded(f"giraff --var {tmp_path}")
    assert (config.mqtt_url, config.server, config.token) == ("mqtt://127.0.0.1:1883", None, "t")
    assert (config.adapter, config.profile) == ("simulator", "giraff")


def test_remote_agent_needs_an_adapter(tmp_path):
    file = tmp_path / "giraff.toml"
    file.write_text('token = "t"\nserver = "https://file.example"\n')
    for server in ("", " --server https://line.example"):
        line = f"giraff --credentials {file}{server}"
        with pytest.raises(ConfigError, match="no adapter is given"):
            loaded(line)
        assert loaded(f"{line} --adapter ros1").adapter == "ros1"
        assert loaded(line, {"TELEPRESENCE_ADAPTER": "moos"}).adapter == "moos"


def test_server_on_the_command_line_overrides_a_broker_in_the_file(tmp_path):
    file = tmp_path / "c.toml"
    file.write_text('token = "t"\nmqtt_url = "mqtt://old.example"\n')
    config = loaded(f"giraff --server https://new.example --credentials {file} --adapter simulator")
    assert (config.server, config.mqtt_url) == ("https://new.example", None)


def test_networks_are_given_in_milliseconds_percent_and_kbit_per_second():
    networks = loaded(
        "giraff --mqtt mqtt://x --control-network delay=150,jitter=30,loss=2"
        " --video-network rate=400 --network-seed 7"
    ).networks
    assert networks.control == NetworkLab(delay=0.15, jitter=0.03, loss=0.02, seed=7)
    assert networks.video == NetworkLab(bitrate=400_000.0, seed=8)
    assert loaded("giraff --mqtt mqtt://x").networks == CLEAN


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        (
            "giraff --mqtt mqtt://x --control-network delay=soon",
            "--control-network: delay must be a number of milliseconds from 0 to 10000",
        ),
        (
            "giraff --mqtt mqtt://x --video-network fast",
            "--video-network: 'fast' is not a network setting",
        ),
        (
            "giraff --mqtt mqtt://x --network-seed -1",
            "--network-seed must be a whole number from 0 to 2147483647, not '-1'",
        ),
        ("Giraff!", "is not a valid robot name"),
        ("server --mqtt mqtt://x", "is not a valid robot name"),
        ("giraff --server https://x --mqtt mqtt://x", "give --server or --mqtt, not both"),
        ("giraff --server x.example", "must begin with https"),
        ("giraff --server https://x.example", "requires credentials"),
        ("giraff --server https:// --adapter moos", "name a host.*not 'https://'"),
        ("giraff --server https://x:many", "--server, TELEPRESENCE_SERVER"),
        ("giraff --server 'https://x y'", "such as https://robots.example.org"),
        ("giraff --mqtt mqtt://x --option seed", "NAME=VALUE, not 'seed'"),
        ("giraff --mqtt mqtt://x --option =8", "NAME=VALUE, not '=8'"),
        ("giraff --mqtt mqtt://x --viewers 1000", "between 0 and 64"),
        ("giraff --credentials /nowhere.toml", "cannot be read"),
    ],
)
def test_invalid_setting_is_reported_in_one_sentence(tmp_path, line, sentence):
    with pytest.raises(ConfigError, match=sentence) as error:
        loaded(f"{line} --var {tmp_path}")
    assert "\n" not in str(error.value)


def test_agent_without_a_site_lists_what_to_do_next(tmp_path):
    with pytest.raises(ConfigError, match="no site is known for the robot giraff") as error:
        loaded(f"giraff --var {tmp_path}")
    for command in ("manage.py enrol giraff", "--credentials FILE", "make demo", "--check"):
        assert command in str(error.value)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        ('robot = "rhodon"\n', "is for the robot 'rhodon'"),
        ("token = \n", "is not valid TOML"),
        ("token = [1]\n", "token has the wrong type: it must be a text in quotes"),
        ("mqtt_url = 1883\n", "mqtt_url has the wrong type: it must be a text in quotes"),
        ("adapter = true\n", "adapter has the wrong type: it must be a text in quotes"),
        ("viewers = true\n", "viewers has the wrong type: it must be a whole number"),
        ("options = 3\n", "options has the wrong type: it must be a table"),
    ],
)
def test_error_in_a_credentials_file_is_named(tmp_path, content, sentence):
    file = tmp_path / "c.toml"
    file.write_text(content)
    with pytest.raises(ConfigError, match=sentence):
        loaded(f"giraff --mqtt mqtt://x --credentials {file}")


@pytest.mark.parametrize(
    ("name", "value", "sentence"),
    [
        ("SERVER", "robots.example.org", "TELEPRESENCE_SERVER, .* not 'robots.example.org'"),
        ("VIEWERS", "many", "TELEPRESENCE_VIEWERS, .* between 0 and 64, not 'many'"),
        ("VIEWERS", "-3", "TELEPRESENCE_VIEWERS, .* between 0 and 64, not '-3'"),
        ("TOKEN", "secret\n", "TELEPRESENCE_TOKEN, .* copy it again"),
        ("TOKEN", "sécret", "TELEPRESENCE_TOKEN, .* copy it again"),
        ("CREDENTIALS", "/nowhere.toml", "/nowhere.toml cannot be read"),
    ],
)
def test_malformed_environment_variable_is_named_with_what_is_expected(name, value, sentence):
    environment = {
        "TELEPRESENCE_SERVER": "https://x.example",
        "TELEPRESENCE_TOKEN": "t",
        "TELEPRESENCE_ADAPTER": "simulator",
    }
    with pytest.raises(ConfigError, match=sentence) as error:
        loaded("giraff", {**environment, f"TELEPRESENCE_{name}": value})
    assert "secret" not in str(error.value)


@pytest.mark.parametrize(
    ("address", "fault"),
    [
        ("http://broker.example", "it begins with none of these"),
        ("broker.example:1883", "it begins with none of these"),
        ("mqtt://", "it names no host"),
        ("mqtt://broker.example:many", "the port must be from 1 to 65535"),
        ("mqtt://broker.example:99999", "the port must be from 1 to 65535"),
        ("mqtt://broker.example:0", "the port must be from 1 to 65535"),
        ("mqtt://bro ker", "it contains blanks"),
        ("mqtt://broker.example, ws://[", "Invalid IPv6 URL"),
    ],
)
def test_malformed_broker_address_is_named_with_its_fault_and_source(address, fault, tmp_path):
    agent = Agent(loaded(f"giraff --mqtt '{address}' --var {tmp_path}"))
    with pytest.raises(ConfigError) as error:
        agent.run()
    assert fault in str(error.value)
    assert address.split(", ")[-1] in str(error.value)
    assert "mqtts://, ws:// or wss://host:port" in str(error.value)
    assert "--mqtt, TELEPRESENCE_MQTT_URL" in str(error.value)


def test_password_in_a_malformed_broker_address_is_not_repeated(tmp_path):
    agent = Agent(loaded(f"giraff --mqtt mqtt://me:xyz/zyx@b:1883 --var {tmp_path}"))
    with pytest.raises(ConfigError, match=r"mqtt://…@b:1883") as error:
        agent.run()
    assert "xyz" not in str(error.value)
    assert "zyx" not in str(error.value)


def test_token_is_not_in_the_representation(credentials):
    assert "from-file" not in repr(loaded(f"giraff --credentials {credentials}"))


GOOD = (200, {"robot": "giraff", "mqttUrl": "mqtt://broker.example:1883", "iceServers": []})


def ask(server, *, give_up_after=10):
    line = f"giraff --server {server.url} --adapter simulator"
    config = loaded(line, {"TELEPRESENCE_TOKEN": "secret"})
    waits = []

    def pause(seconds):
        waits.append(seconds)
        return len(waits) >= give_up_after

    return broker_urls(config, Backoff(random.Random(1), first=0.001), pause), waits


def test_server_returns_the_brokers_address():
    with AgentServer(GOOD) as server:
        assert ask(server) == (("mqtt://broker.example:1883",), [])
    assert server.requests == [("/api/v1/agent/", "Bearer giraff:secret", b"")]


def test_agent_gets_all_broker_addresses_in_order():
    urls = ["mqtts://broker.example:8883", "wss://broker.example/mqtt"]
    with AgentServer((200, {"robot": "giraff", "mqttUrl": urls[0], "mqttUrls": urls})) as server:
        assert ask(server) == (tuple(urls), [])
    config = loaded(f"giraff --mqtt '{', '.join(urls)}'")
    assert broker_urls(config, Backoff(random.Random(1)), lambda _: True) == tuple(urls)


@pytest.mark.parametrize(
    "bad", [(500, b""), (429, {}), (200, b"<html>"), (200, {"robot": "giraff"}), (200, [])]
)
def test_failing_server_is_asked_again(bad):
    with AgentServer(bad, bad, GOOD) as server:
        urls, waits = ask(server)
    assert urls == ("mqtt://broker.example:1883",)
    assert len(waits) == 2


def test_unreachable_server_is_asked_until_the_agent_ends():
    server = AgentServer(GOOD)
    server._server.server_close()
    assert ask(server, give_up_after=3)[0] is None


@pytest.mark.parametrize(
    ("answer", "sentence"),
    [
        ((401, {}), "refused the credentials"),
        ((403, {}), "refused the credentials"),
        ((404, b""), "not a telepresence server"),
        ((421, {"detail": "giraff is served by https://n."}), r"giraff is served by https://n\."),
        ((200, {"robot": "rhodon", "mqttUrl": "mqtt://x"}), "credentials are for 'rhodon'"),
        ((200, {"robot": "rhodon", "mqttUrls": ["mqtt://x", 1]}), "credentials are for 'rhodon'"),
        (
            (200, {"robot": "giraff", "mqttUrls": ["mqtt://x", 1]}),
            r'names no usable broker: .* not \["mqtt://x", 1\]; correct MQTT_PUBLIC_URL',
        ),
        ((200, {"robot": "giraff", "mqttUrl": None}), r"names no usable broker: .* not \[null\]"),
        ((200, {"robot": "giraff", "mqttUrls": "mqtt://x"}), "names no usable broker"),
    ],
)
def test_permanent_refusal_ends_the_agent_with_a_sentence(answer, sentence):
    with AgentServer(answer) as server, pytest.raises(ConfigError, match=sentence):
        ask(server)


def test_unusable_broker_of_the_server_is_named_with_the_setting_to_correct(tmp_path):
    with AgentServer((200, {"robot": "giraff", "mqttUrl": "https://broker.example"})) as server:
        line = f"giraff --server {server.url} --adapter simulator --var {tmp_path}"
        agent = Agent(loaded(line, {"TELEPRESENCE_TOKEN": "secret"}))
        with pytest.raises(ConfigError, match=r"https://broker\.example.*correct MQTT"):
            agent.run()
