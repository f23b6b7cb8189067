import datetime

import pytest
from django.conf import settings

from robots.cards import STATES, Traffic, card
from robots.models import FloorPlan, Robot
from tests.support.robots import unsaved_robot

NOW = datetime.datetime(2026, 3, 1, 12, 0, tzinfo=datetime.UTC)


def robot(**changes) -> Robot:
    fields = {
        "name": "giraff",
        "title": "Giraff",
        "connection": "ONLINE",
        "last_seen_at": NOW,
        "report": {"battery": {"charge": 0.824}},
    }
    return unsaved_robot(**(fields | changes))


def shown(traffic: Traffic | None = None, barred: str = "", **changes):
    return card(
        robot(**changes), traffic or Traffic(), barred=barred, url="/robots/giraff/", now=NOW
    )


def test_a_robot_without_a_driver_is_free():
    it = shown()
    assert (it.state, it.label, it.drives) == ("available", "Free now", True)
    assert it.action == "Drive Giraff"
    assert (it.charge, it.battery) == (82, "82 %")


def test_a_hidden_robot_is_marked_as_hidden():
    assert shown(shown_to_visitors=False).detail == "Ready, but hidden from visitors."


def test_a_robot_with_a_driver_offers_the_next_place():
    it = shown(Traffic(in_use=True))
    assert (it.state, it.action, it.drives) == ("busy", "Join the queue", True)
    assert it.detail == "Somebody is driving. You would be next."


@pytest.mark.parametrize(
    ("waiting", "words"), [(1, "1 visitor in the queue."), (3, "3 visitors in the queue.")]
)
def test_the_line_is_counted(waiting, words):
    assert shown(Traffic(in_use=True, waiting=waiting)).detail == words


def test_a_robot_between_two_turns_is_busy_while_a_visitor_waits():
    assert shown(Traffic(in_use=False, waiting=1)).state == "busy"


@pytest.mark.parametrize(
    "changes",
    [
        {"connection": "OFFLINE"},
        {"connection": "CONNECTIONBROKEN"},
        {"last_seen_at": NOW - datetime.timedelta(minutes=5)},
        {"enabled": False},
    ],
)
def test_an_absent_robot_cannot_be_driven_and_shows_no_battery(changes):
    it = shown(**changes)
    assert (it.state, it.drives, it.charge, it.battery) == ("offline", False, None, "")


def test_an_offline_robot_has_the_time_of_its_last_message():
    for seen_at, words in (
        (NOW - datetime.timedelta(hours=3, minutes=7), "Last seen 3\xa0hours ago."),
        (NOW - datetime.timedelta(seconds=59), "Last seen just now."),
        (None, "This robot hasn't connected yet."),
    ):
        assert shown(connection="OFFLINE", last_seen_at=seen_at).detail == words


@pytest.mark.parametrize("reason", ["not_invited", "not_trained", "disabled"])
def test_a_visitor_who_may_not_drive_reads_the_reason(reason):
    it = shown(barred=reason)
    assert not it.drives
    assert it.action == "Open its page"
    assert it.detail != "Ready when you are."


@pytest.mark.parametrize(
    "report",
    [None, [], "x", {}, {"battery": None}, {"safety": 3, "errors": 7}]
    + [{"battery": {"charge": charge}} for charge in ("full", 7, float("nan"))],
)
def test_a_malformed_report_shows_no_battery(report):
    it = shown(report=report)
    assert (it.state, it.charge) == ("available", None)


@pytest.mark.parametrize(
    ("factsheet", "picture"),
    [
        (None, "any"),
        ({"series": "giraff"}, "giraff"),
        ({"series": "rhodon"}, "rhodon"),
        ({"series": "../../secret"}, "any"),
        ({"series": ["giraff"]}, "any"),
    ],
)
def test_a_picture_is_one_of_ours(factsheet, picture):
    assert shown(factsheet=factsheet).picture == f"img/robots/{picture}.svg"


def test_card_shows_charging_and_place():
    it = shown(
        report={"battery": {"charge": 1.0, "charging": True}},
        floor_plan=FloorPlan(name="office", title="Office"),
    )
    assert (it.battery, it.place) == ("100 %, charging", "Office")


def test_lists_start_with_free_robots():
    assert STATES == ("available", "busy", "stopped", "offline")


@pytest.mark.parametrize(
    ("turnaround", "label"),
    [("returning", "Returning to its station"), ("charging", "Charging"), ("paused", "Not ready")],
)
def test_a_robot_between_two_sessions_shows_its_activity_and_has_a_queue(turnaround, label):
    it = shown(returns_home=True, turnaround=turnaround)
    assert (it.state, it.label, it.action) == ("busy", label, "Join the queue")
    assert shown(Traffic(in_use=True), returns_home=True, turnaround=turnaround).label == "In use"
    assert shown(returns_home=False, turnaround=turnaround).state == "available"


def test_a_robot_that_was_stopped_between_sessions_is_free_and_marked():
    stopped = {"returns_home": True, "turnaround": "paused", "turnaround_reason": "stopped"}
    it = shown(**stopped)
    assert (it.state, it.label, it.action) == ("available", "Stopped", "Drive Giraff")
    assert it.badge == "held"
    assert (
        it.detail
        == "Someone stopped it after the last visit. It can move again once you start to drive."
    )
    busy = shown(Traffic(in_use=True), **stopped)
    assert (busy.label, busy.badge) == ("In use", "busy")


@pytest.mark.parametrize(
    ("turnaround", "reason", "docked", "label", "detail"),
    [
        ("returning", "dock", False, "Returning to its station", "It needs to dock first."),
        ("returning", "picture", True, "Getting ready", "It is running its self-check."),
        ("paused", "dock_failed", False, "Not ready", "The robot didn't reach its station."),
        ("paused", "no_picture", True, "Not ready", "The robot couldn't get ready"),
    ],
)
def test_the_sentence_depends_on_whether_the_robot_is_docked(
    turnaround, reason, docked, label, detail
):
    it = shown(
        returns_home=True,
        turnaround=turnaround,
        turnaround_reason=reason,
        report={"docked": docked},
    )
    assert it.label == label
    assert it.detail.startswith(detail)


@pytest.mark.parametrize(
    ("waiting", "minutes", "words"),
    [
        (0, 3.2, "Somebody is driving. You would be next, in about 4 min."),
        (0, 0.0, "Somebody is driving. You would be next, in about 1 min."),
        (2, 31.0, "You'd be number 3 in the queue, with a wait of about 31 min."),
    ],
)
def test_a_busy_robot_shows_the_next_place_and_its_wait(waiting, minutes, words):
    assert shown(Traffic(in_use=True, waiting=waiting, minutes=minutes)).detail == words


@pytest.mark.parametrize(
    ("minutes", "words"),
    [
        (None, "You are number 2 in the queue."),
        (7.5, "You are number 2 in the queue, with a wait of about 8 min."),
    ],
)
@pytest.mark.parametrize("changes", [{}, {"held": True}])
def test_the_card_shows_a_waiting_visitor_their_place_and_leads_back_to_it(minutes, words, changes):
    it = shown(Traffic(in_use=True, waiting=3, place=2, minutes=minutes), **changes)
    assert (it.state, it.detail, it.action, it.own) == ("busy", words, "Back to the queue", True)


LOST = {"errors": ["lens dirty", "adapter_lost: the MOOSDB at 10.0.0.7:9000 does not answer"]}


ESTOP, FAULT = {"safety": {"estop": True}}, {"safety": {"inhibited": "fault"}}
RUNS_ON = {"safety": {"inhibited": "no_lease"}, "errors": ["lens dirty", "runs_on: it moves"]}
DRIVEN = Traffic(in_use=True, waiting=2)


@pytest.mark.parametrize(
    ("traffic", "changes", "state", "label", "detail"),
    [
        (DRIVEN, {"report": ESTOP}, "stopped", "Stopped", ""),
        (Traffic(), {"report": LOST}, "stopped", "Not available", ""),
        (DRIVEN, {"report": LOST}, "stopped", "Not available", ""),
        (Traffic(), {"report": LOST | ESTOP}, "stopped", "Stopped", ""),
        (Traffic(), {"report": LOST, "connection": "OFFLINE"}, "offline", "Offline", ""),
        (
            Traffic(),
            {"report": FAULT | {"errors": ["rival: another agent runs"]}},
            "stopped",
            "Not available",
            "The robot has a fault. You can drive again once it is fixed.",
        ),
        (Traffic(), {"report": RUNS_ON}, "stopped", "Not available", ""),
    ],
)
def test_a_stop_or_a_fault_is_listed_first_and_details_of_a_fault_are_hidden(
    traffic, changes, state, label, detail
):
    it = shown(traffic, **changes)
    assert (it.state, it.label, it.drives) == (state, label, False)
    assert detail in it.detail
    assert not any(word in it.detail for word in ("10.0.0.7", "rival", "runs_on"))


@pytest.mark.parametrize(
    "report",
    [{"errors": ["lens dirty"]}]
    + [{"safety": {"inhibited": why}} for why in ("collision", "stopped", "no_lease")],
)
def test_a_robot_that_refuses_single_commands_is_available(report):
    assert shown(report=report).state == "available"


def test_a_robot_that_does_not_stop_has_the_sentence_of_the_page():
    it = shown(report=RUNS_ON)
    page = (settings.BASE_DIR / "templates/sessions/_words.html").read_text()
    assert f'data-word="lobby.runs_on.text">{{% translate "{it.detail}" %}}' in page


@pytest.mark.parametrize("source", ["screen:Giraff", "button"])
def test_a_stop_at_the_robot_is_shown_as_such(source):
    report = {"safety": {"estop": True, "estopSource": source}}
    assert shown(report=report).detail.startswith("Stopped by someone next to it.")
