"""Connects studies to the signals and registries of the apps below."""

from typing import Any

from django.db.models.signals import post_delete, post_save, pre_delete

from accounts.models import User
from experiments.access import forget_members
from experiments.models import Study, StudyMember
from experiments.participation.grants import StudyTerms, claimed, invited_to
from experiments.participation.questions import outer_progress
from experiments.participation.withdrawal.deletion import clear_settled, withdraw_everywhere
from experiments.research.notices import publish_not_ready, publish_pause
from experiments.tasks.runner import Runner
from experiments.wizard.operators import StudyOperators
from robots.access import register_guest_list, register_guest_rule
from sessions import signals
from sessions.leases import terms
from sessions.page_channel import check_pages, visitor_group
from sessions.wizard import operators
from surveys.outer_progress import register_outer_progress

STUDY_TERMS = StudyTerms()
STUDY_OPERATORS = StudyOperators()
RUNNER = Runner()


def connect() -> None:
    """Register for the life of this process; a second time changes nothing."""
    terms.register(STUDY_TERMS)
    operators.register(STUDY_OPERATORS)
    register_outer_progress(outer_progress)
    register_guest_list(invited_to)
    register_guest_rule(User.Kind.PARTICIPANT, claimed)
    pre_delete.connect(
        withdraw_everywhere, sender=User, weak=False, dispatch_uid="experiments.withdraw_everywhere"
    )
    post_delete.connect(
        forget_members, sender=Study, weak=False, dispatch_uid="experiments.forget_members"
    )
    for signal in (post_save, post_delete):
        signal.connect(
            _member_changed, sender=StudyMember, dispatch_uid="experiments.member_changed"
        )
    for signal, receiver in (
        (signals.state_received, RUNNER.on_state),
        (signals.state_recovered, RUNNER.on_state),
        (signals.message_received, RUNNER.on_message),
        (signals.ticked, RUNNER.tick),
        (signals.ticked, clear_settled),
        (signals.session_ended, RUNNER.on_end),
        (signals.queue_paused, publish_pause),
        (signals.not_ready, publish_not_ready),
    ):
        signal.connect(receiver, weak=False, dispatch_uid=f"experiments.{receiver.__qualname__}")


def _member_changed(instance: StudyMember, **_more: Any) -> None:
    """Have the open pages of a member whose role in a study changed check if they may stay."""
    check_pages(visitor_group(instance.user_id))
