"""Log lines: their fields, the ids of their context, and no secrets."""

import json
import logging
import shlex
import threading
from collections import Counter

import pytest

from robots.process import log_ids, logs
from telepresence_site.ops.log_lines import json_lines, key_value_lines, known_secrets


def made(message, *arguments, name="robots.bridge.bridge", level=logging.INFO, **extra):
    record = logging.getLogger(name).makeRecord(name, level, "f", 1, message, arguments, None)
    record.__dict__.update(extra)
    return record


def record(event, **fields):
    (message,), passed_on = logs.to_standard_library(None, "info", {"event": event, **fields})
    return made(message, **passed_on.pop("extra"), **passed_on)


def failure(message):
    """Return a record with a traceback."""

    def fail():
        raise ValueError(message)

    try:
        fail()
    except ValueError:
        return record("verb_failed", exc_info=True)


def as_json(event, **fields):
    return json.loads(json_lines().format(record(event, **fields)))


def as_pairs(event, **fields):
    line = key_value_lines().format(record(event, **fields))
    return dict(pair.split("=", 1) for pair in shlex.split(line))


def own(line):
    return {name: line[name] for name in line if name not in {"time", "level", "logger"}}


def test_an_event_keeps_its_fields_and_their_kinds():
    assert own(as_json("bridge_lost", attempt=2, reason="no route to host")) == {
        "event": "bridge_lost",
        "attempt": 2,
        "reason": "no route to host",
    }
    assert own(as_json("page_left", counts=Counter(stale=3))) == {
        "event": "page_left",
        "counts": {"stale": 3},
    }
    assert own(as_json("broker_started")) == {"event": "broker_started"}


def test_an_event_is_one_line_of_text_for_formatters_without_fields():
    assert record("bridge_lost", attempt=2, reason="no route").getMessage() == (
        'bridge_lost attempt=2 reason="no route"'
    )
    assert record("broker_started").getMessage() == "broker_started"


@pytest.mark.parametrize(
    ("message", "arguments"), [("Listening on %s", ("x",)), ("Not an event", ()), ("it=%d", (1,))]
)
def test_a_line_of_another_library_is_one_message(message, arguments):
    line = json.loads(json_lines().format(made(message, *arguments)))
    assert own(line) == {"event": "bridge", "message": message % arguments}


def test_both_formats_have_the_same_fields():
    fields = {"attempt": 2, "reason": 'no "route"'}
    with log_ids.about(request="abc", robot="giraff"):
        line, pairs = as_json("bridge_lost", **fields), as_pairs("bridge_lost", **fields)
    del pairs["time"]
    assert {name: str(value) for name, value in line.items() if name != "time"} == pairs
    assert line["request"] == "abc"
    assert line["level"] == "info"


def test_a_line_has_the_ids_of_its_context_unless_its_own_fields_differ():
    with log_ids.about(request="r1", robot="giraff"), log_ids.about(session="s1"):
        line = as_json("robot_lost", robot="rhodon")
    assert (line["request"], line["session"], line["robot"]) == ("r1", "s1", "rhodon")
    assert "session" not in as_json("robot_lost", robot="rhodon")


def test_ids_of_a_line_are_looked_up_when_it_is_written():
    page = {"session": None}
    token = log_ids.bind(lambda: page)
    assert "session" not in as_json("a_word")
    page["session"] = "s2"
    assert as_json("a_word")["session"] == "s2"
    log_ids.unbind(token)


def test_a_process_of_one_robot_names_it_in_every_thread(monkeypatch):
    monkeypatch.setattr(log_ids, "_process", {})
    log_ids.of_process(robot="giraff")
    lines = []
    thread = threading.Thread(target=lambda: lines.append(as_json("a_word")))
    thread.start()
    thread.join()
    assert lines[0]["robot"] == "giraff"


def test_a_value_with_line_ends_stays_on_its_line():
    forged = record("refused", user="x\nlevel=error event=forged")
    assert "\n" not in key_value_lines().format(forged)
    assert "\n" not in json_lines().format(forged)


def test_a_failure_keeps_its_traceback():
    failed = failure("of the test")
    assert "ValueError: of the test" in json.loads(json_lines().format(failed))["traceback"]
    assert key_value_lines().format(failed).endswith("ValueError: of the test")


def test_a_failed_request_is_logged_without_its_path():
    path = "/accounts/password/reset/key/1-abcdef-123/"
    failed = made("%s: %s", "Not Found", path, name="django.request", status_code=404)
    line = json.loads(json_lines().format(failed))
    assert (line["event"], line["reason"], line["status"]) == ("request_problem", "Not Found", 404)
    assert "1-abcdef-123" not in json.dumps(line)


@pytest.mark.parametrize("format_", [json_lines, key_value_lines])
@pytest.mark.parametrize(
    "entry",
    [
        record("lost", url="mqtt://server.web:hunter2hunter2@broker.example:1883"),
        record("asked", headers={"Cookie": "hunter2hunter2"}),
        record("asked", token="hunter2hunter2"),
        record("asked", headers="{'cookie': 'sessionid=hunter2hunter2; csrftoken=hunter2hunter2'}"),
        made("Sent headers [(b'Authorization', b'Bearer hunter2hunter2')]"),
        made("could not connect: password=hunter2hunter2 host=db"),
        made("found %s", "a turn secret: shared-with-coturn-hunter2hunter2"),
    ],
)
def test_secrets_are_struck_out(settings, format_, entry):
    settings.TURN_SECRET = "shared-with-coturn-hunter2hunter2"
    assert "hunter2" not in format_().format(entry)


def test_a_traceback_loses_its_secrets_too(settings):
    settings.TURN_SECRET = "shared-with-coturn"
    failed = failure("wrong: shared-with-coturn")
    lines = json_lines().format(failed) + key_value_lines().format(failed)
    assert "shared-with-coturn" not in lines


def test_passwords_of_addresses_count_as_secrets(settings):
    settings.REDIS_URL = "redis://:aRedisPassword@127.0.0.1:6379"
    settings.MQTT_URL = "mqtts://web:p%40ssword-of-mqtt@broker:8883"
    assert {"aRedisPassword", "p%40ssword-of-mqtt", "p@ssword-of-mqtt"} <= set(known_secrets())
