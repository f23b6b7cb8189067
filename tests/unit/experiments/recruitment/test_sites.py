from urllib.parse import parse_qs, urlsplit

import pytest

from experiments.definition.recruitment.recruiting import Recruiting
from experiments.recruitment.sites import (
    PROFILES,
    UNNAMED,
    Arrival,
    arrival,
    return_address,
    study_link,
)

PROLIFIC = {"PROLIFIC_PID": "5f0c", "STUDY_ID": "60ac", "SESSION_ID": "625d"}
MTURK = {"workerId": "A1", "assignmentId": "3X", "hitId": "H", "turkSubmitTo": ""}


@pytest.mark.parametrize(
    ("site", "parameters", "expected"),
    [
        ("any", PROLIFIC, Arrival("prolific", "5f0c", "625d")),
        ("any", MTURK, Arrival("mturk", "A1", "3X")),
        ("any", {"survey_code": "77"}, Arrival("sona", "77")),
        ("any", {"participantId": "C", "assignmentId": "D"}, Arrival("cloudresearch", "C", "D")),
        ("prolific", MTURK, UNNAMED),
        ("any", {"utm_source": "mail"}, UNNAMED),
        ("any", {"PROLIFIC_PID": "   "}, UNNAMED),
    ],
)
def test_the_parameters_of_each_site_say_who_came(site, parameters, expected):
    assert arrival(Recruiting(site=site), parameters) == expected


@pytest.mark.parametrize(
    "value", ["{{%PROLIFIC_PID%}}", "%SURVEY_CODE%", "${e://Field/id}", "[id]"]
)
def test_placeholder_that_the_site_did_not_fill_in_is_no_id(value):
    assert arrival(None, {"PROLIFIC_PID": value}) == UNNAMED


def test_worker_who_previews_a_task_has_no_id():
    assert arrival(None, {**MTURK, "assignmentId": "ASSIGNMENT_ID_NOT_AVAILABLE"}) == UNNAMED


def test_another_sites_own_parameter_holds_the_id():
    own = Recruiting(site="other", id_parameter="participant_label")
    assert arrival(own, {"participant_label": "ada"}) == Arrival("other", "ada")


@pytest.mark.parametrize(
    ("recruiting", "parameters", "ending", "expected"),
    [
        (None, PROLIFIC, "done", "https://app.prolific.com/submissions/complete?cc=AB%2F1"),
        (
            None,
            MTURK,
            "done",
            "https://www.mturk.com/mturk/externalSubmit?assignmentId=3X&code=AB%2F1",
        ),
        (None, {"survey_code": "7"}, "done", ""),
        (None, {}, "done", ""),
    ],
)
def test_each_site_is_returned_to_with_the_code(recruiting, parameters, ending, expected):
    assert return_address(recruiting, parameters, ending, "AB/1") == expected


def test_values_in_a_return_address_cannot_change_where_it_leads():
    own = Recruiting(site="other", id_parameter="p", return_address="https://s.example/?id={id}")
    found = return_address(own, {"p": "a&admin=1#x/../{code}"}, "done", "C")
    assert urlsplit(found).netloc == "s.example"
    assert parse_qs(urlsplit(found).query) == {"id": ["a&admin=1#x/../{code}"]}


@pytest.mark.parametrize(
    ("submit_to", "host"),
    [
        ("https://workersandbox.mturk.com", "workersandbox.mturk.com"),
        ("https://evil.example", "www.mturk.com"),
        ("https://www.mturk.com@evil.example", "www.mturk.com"),
    ],
)
def test_an_assignment_is_submitted_only_to_the_sites_own_hosts(submit_to, host):
    found = return_address(None, {**MTURK, "turkSubmitTo": submit_to}, "done", "C")
    assert urlsplit(found).netloc == host


def test_sona_grants_no_credit_to_who_was_turned_away_or_left():
    own = Recruiting(
        site="sona",
        return_address="https://u.sona-systems.com/webstudy_credit.aspx?experiment_id=1"
        "&credit_token=2&survey_code={id}",
    )
    ends = {
        ending: bool(return_address(own, {"survey_code": "7"}, ending, "C"))
        for ending in ("done", "timed_out", "technical_failure", "screened_out", "left")
    }
    assert [name for name, leads in ends.items() if leads] == [
        "done",
        "timed_out",
        "technical_failure",
    ]


def test_there_is_no_return_address_without_a_code():
    assert return_address(None, PROLIFIC, "screened_out", "") == ""


def test_the_link_for_a_site_ends_in_its_placeholders():
    address = "https://site.example/studies/s/"
    assert study_link(Recruiting(site="prolific"), address) == (
        f"{address}?{PROFILES['prolific'].query}"
    )
    assert study_link(None, address) == address
