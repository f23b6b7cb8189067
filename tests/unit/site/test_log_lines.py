"""Log lines: what they say, what they are about, and what never stands in them."""

import json
import logging
import shlex
import sys
import threading

import pytest

from robots import log_ids
from telepresence_site.ops.log_lines import JsonLine, KeyValueLine, fields_of, known_secrets


def record(message, *arguments, name="robots.bridge.bridge", level=logging.INFO, **extra):
    made = logging.getLogger(name).makeRecord(name, level, "f", 1, message, arguments, None)
    made.__dict__.update(extra)
    return made


def failure(message):
    """Return a record with a traceback."""

    def fail():
        raise ValueError(message)

    try:
        fail()
    except ValueError:
        return record("verb_failed", exc_info=sys.exc_info())


def as_json(*arguments, **options):
    return json.loads(JsonLine().format(record(*arguments, **options)))


def as_pairs(*arguments, **options):
    return dict(
        pair.split("=", 1)
        for pair in shlex.split(KeyValueLine().format(record(*arguments, **options)))
    )


def test_an_event_with_fields_is_read_from_its_template():
    assert fields_of(record("bridge_lost attempt=%d reason=%s", 2, "no route to host")) == (
        "bridge_lost",
        {"attempt": 2, "reason": "no route to host"},
    )
    assert fields_of(record("page_left counts=%s", {"stale": 3})) == (
        "page_left",
        {"counts": {"stale": 3}},
    )
    assert fields_of(record("request_done milliseconds=%.1f", 1.2345)) == (
        "request_done",
        {"milliseconds": 1.2},
    )
    assert fields_of(record("broker_started")) == ("broker_started", {})


@pytest.mark.parametrize(
    ("message", "arguments"),
    [
        ("Listening on %s", ("x",)),
        ("Not an event", ()),
        ("half_event a=%s b", ("x",)),
        ("it=%d", (1,)),
        ("too_many a=%s=%s", ("x", "y")),
    ],
)
def test_what_others_say_is_one_message(message, arguments):
    assert fields_of(record(message, *arguments)) == ("bridge", {"message": message % arguments})


def test_both_formats_say_the_same():
    with log_ids.about(request="abc", robot="giraff"):
        line, pairs = (
            as_json("bridge_lost attempt=%d reason=%s", 2, 'no "route"'),
            as_pairs("bridge_lost attempt=%d reason=%s", 2, 'no "route"'),
        )
    assert {name: str(value) for name, value in line.items() if name != "time"} == {
        name: value for name, value in pairs.items() if name != "time"
    }
    assert line["request"] == "abc"
    assert line["level"] == "info"


def test_a_line_carries_what_it_is_about_and_its_own_words_win():
    with log_ids.about(request="r1", robot="giraff"), log_ids.about(session="s1"):
        line = as_json("robot_lost robot=%s", "rhodon")
    assert (line["request"], line["session"], line["robot"]) == ("r1", "s1", "rhodon")
    assert "session" not in as_json("robot_lost robot=%s", "rhodon")


def test_what_a_line_is_about_is_asked_when_it_is_written():
    page = {"session": None}
    token = log_ids.bind(lambda: page)
    assert "session" not in as_json("a_word")
    page["session"] = "s2"
    assert as_json("a_word")["session"] == "s2"
    log_ids.unbind(token)


def test_a_process_of_one_robot_names_it_in_every_thread(monkeypatch):
    monkeypatch.setattr(log_ids, "_process", {})
    log_ids.of_process(robot="giraff")
    said = []
    thread = threading.Thread(target=lambda: said.append(as_json("a_word")))
    thread.start()
    thread.join()
    assert said[0]["robot"] == "giraff"


def test_a_value_with_line_ends_cannot_make_a_line_of_its_own():
    assert "\n" not in KeyValueLine().format(
        record("refused user=%s", "x\nlevel=error event=forged")
    )
    assert "\n" not in JsonLine().format(record("refused user=%s", "x\nlevel=error event=forged"))


def test_a_failure_keeps_its_traceback():
    failed = failure("of the test")
    assert "ValueError: of the test" in json.loads(JsonLine().format(failed))["traceback"]
    assert KeyValueLine().format(failed).endswith("ValueError: of the test")


def test_a_request_that_failed_is_told_by_its_route_and_not_by_its_path():
    line = as_json(
        "%s: %s",
        "Not Found",
        "/accounts/password/reset/key/1-abcdef-123/",
        name="django.request",
        status_code=404,
    )
    assert (line["event"], line["reason"], line["status"]) == ("request_problem", "Not Found", 404)
    assert "1-abcdef-123" not in json.dumps(line)


@pytest.mark.parametrize("format_", [JsonLine, KeyValueLine])
@pytest.mark.parametrize(
    "said",
    [
        ("lost url=%s", "mqtt://server.web:hunter2hunter2@broker.example:1883"),
        ("asked headers=%s", {"Cookie": "hunter2hunter2"}),
        ("asked token=%s", "hunter2hunter2"),
        ("asked headers=%s", "{'cookie': 'sessionid=hunter2hunter2; csrftoken=hunter2hunter2'}"),
        ("Sent headers [(b'Authorization', b'Bearer hunter2hunter2')]",),
        ("could not connect: password=hunter2hunter2 host=db",),
        ("found %s", "a turn secret: shared-with-coturn-hunter2hunter2"),
    ],
)
def test_secrets_are_struck_out(settings, format_, said):
    settings.TURN_SECRET = "shared-with-coturn-hunter2hunter2"
    assert "hunter2" not in format_().format(record(*said))


def test_a_traceback_loses_its_secrets_too(settings):
    settings.TURN_SECRET = "shared-with-coturn"
    failed = failure("wrong: shared-with-coturn")
    assert "shared-with-coturn" not in JsonLine().format(failed) + KeyValueLine().format(failed)


def test_passwords_of_addresses_count_as_secrets(settings):
    settings.REDIS_URL = "redis://:aRedisPassword@127.0.0.1:6379"
    settings.MQTT_URL = "mqtts://web:p%40ssword-of-mqtt@broker:8883"
    assert {"aRedisPassword", "p%40ssword-of-mqtt", "p@ssword-of-mqtt"} <= set(known_secrets())
