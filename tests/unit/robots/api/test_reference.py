import re
from functools import cache
from typing import get_args

import pytest

from docs import robot_api
from robots.agent.control import dispatcher, owned_actions, reports
from robots.agent.ramp import LONGEST_DEADMAN, LONGEST_WATCHDOG
from robots.agent.safety import freshness, hold, permissions
from robots.agent.safety.kernel import KERNEL, STANDSTILL
from robots.api import messages, topics
from robots.api.errors import RejectionReason
from robots.api.reasons import ReasonCode
from tests.support.paths import ROOT

reference = cache(robot_api.reference)


@pytest.mark.parametrize("name", robot_api.generated_files())
def test_generated_files_are_up_to_date(name):
    assert (ROOT / name).read_text(encoding="utf-8") == robot_api.generated_files()[name], (
        "run make docs"
    )


def test_the_reference_states_the_version_and_the_root_of_the_topics():
    assert reference().startswith(f"# Robot API, version {messages.VERSION}\n")
    assert f"- Topics are `{topics.ROOT}/<robot>/<suffix>`." in reference()


@pytest.mark.parametrize("topic", robot_api.TOPICS, ids=lambda topic: topic.suffix)
def test_the_reference_has_every_topic_with_its_messages_and_an_example(topic):
    section = reference().partition(f"### `{topic.suffix}`\n")[2].partition("\n### ")[0]
    assert topic.doc[1:] in section
    for kind in robot_api.classes(topic.content):
        assert f"#### {kind.__name__}\n" in section
    assert topic.content is bytes or "```json" in section


def test_every_link_to_a_part_has_its_heading():
    text = reference()
    for name in [
        kind.__name__
        for kind in vars(messages).values()
        if isinstance(kind, type) and f"](#{kind.__name__.lower()})" in text
    ]:
        assert f"# {name}\n" in text


def rules():
    """What an agent in another language must do, on one line."""
    text = reference().partition("## What an agent must do by itself\n")[2]
    return " ".join(text.partition("\n## ")[0].split())


def test_the_rules_of_an_agent_name_every_reason_for_a_refusal():
    table = (ROOT / "docs/explanation/safety.md").read_text(encoding="utf-8")
    rows = table.partition("## Refusal reasons")[2].partition("**Releasing")[0].splitlines()
    cells = [row.partition(" | ")[0] for row in rows if row.startswith("|")]
    reasons = {word for cell in cells for word in re.findall(r"`(\w+)`", cell)}
    assert len(reasons) > 25
    assert {reason for reason in reasons if f"`{reason}`" not in rules()} == set()
    assert reasons - {*ReasonCode, *get_args(RejectionReason)} == set(), "not declared"


def test_the_rules_of_an_agent_name_the_actions_without_a_lease():
    (sentence,) = re.findall(r"Without a lease .*? never the driver's", rules())
    for kind, roles in permissions.WITHOUT_LEASE.items():
        assert f"`{kind.__struct_config__.tag}`" in sentence
        assert all(f"`{role}`" in rules() for role in roles)


@pytest.mark.parametrize(
    "figure",
    [
        f"`deadman` is at most {LONGEST_DEADMAN:g} s, `watchdog` at most {LONGEST_WATCHDOG:g} s",
        (
            f"at most {STANDSTILL.linear:g} m/s and {STANDSTILL.angular:g} rad/s for"
            f" {KERNEL.at_rest_for:g} s"
        ),
        f"{KERNEL.navigation_silence:g} s after the driver's last heartbeat",
        f"The same `actionId` within {KERNEL.same_stop:g} s",
        (
            f"more than {freshness.FUTURE_TOLERANCE:g} s and half of the round trip, at most"
            f" {freshness.FUTURE_TOLERANCE_CEILING:g} s"
        ),
        f"by more than {freshness.FRAME_FUTURE_TOLERANCE:g} s (`frame_future`)",
        f"{hold.QUIET_RELEASES:g} s without a velocity other than zero",
        f"exceeds a limit by {100 * (KERNEL.overspeed - 1):.0f} % for {KERNEL.overspeed_for:g} s",
        f"every {owned_actions.CANCEL_PERIOD:g} s until then",
        f"at most {hold.HEARTBEAT_GAP:g} s apart",
        f"more than {permissions.ACTION_AGE:g} s old",
        f"at most {1 / reports.POSE_PERIOD:.0f} times a second",
    ],
)
def test_the_figures_of_the_rules_are_those_of_our_agent(figure):
    assert figure in rules()


def test_the_rates_of_the_rules_are_those_of_our_agent():
    assert (reports.STATE_PERIOD, dispatcher.HEARTBEAT_PERIOD) == (1 / 4, 1 / 5)
    assert reports.STATES_KEPT * reports.STATE_PERIOD >= 600.0
