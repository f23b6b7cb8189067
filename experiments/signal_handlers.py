"""Connects studies to the signals and registries of the apps below."""

from typing import Any

from django.db.models.signals import post_delete, post_save, pre_delete

from accounts.models import User
from experiments import instruction_media
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
    """Register for the life of this process; a second call changes nothing."""
    terms.register(STUDY_TERMS)
    operators.register(STUDY_OPERATORS)
    register_outer_progress(outer_progress)
    register_guest_list(invited_to)
    register_guest_rule(User.Kind.PARTICIPANT, claimed)
    for signal, receiver, sender in (
        (pre_delete, withdraw_everywhere, User),
        (post_delete, forget_members, Study),
        (post_delete, instruction_media.forget, Study),
        (post_save, _member_changed, StudyMember),
        (post_delete, _member_changed, StudyMember),
        (signals.state_received, RUNNER.on_state, None),
        (signals.state_recovered, RUNNER.on_state, None),
        (signals.message_received, RUNNER.on_message, None),
        (signals.ticked, RUNNER.tick, None),
        (signals.ticked, clear_settled, None),
        (signals.session_ended, RUNNER.on_end, None),
        (signals.queue_paused, publish_pause, None),
        (signals.not_ready, publish_not_ready, None),
    ):
        uid = f"experiments.{receiver.__qualname__}"
        signal.connect(receiver, sender, weak=False, dispatch_uid=uid)


def _member_changed(instance: StudyMember, **_more: Any) -> None:
    check_pages(visitor_group(instance.user_id))
