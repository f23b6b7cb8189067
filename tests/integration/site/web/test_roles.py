"""Every address of the site against every role, for things of their own or of others.

All things belong to one robot and one study. Roles are the robot's owner, the study's members and
its participant, and people with the same roles for another robot and study, who must find nothing.
An address that is missing in this file fails the first test.
"""

import uuid

import pytest
from django.contrib.contenttypes.models import ContentType
from django.db import transaction
from django.test import Client
from django.urls import get_resolver, reverse
from django.utils import timezone

from experiments.coding import store as coding
from experiments.models import ConsentReceipt, Rehearsal, Study, StudyMember
from experiments.participation import links
from robots.models import FloorPlan, Robot, RobotPresence
from sessions.models import ApiKey, Lease, ManagerBeat, Snapshot, SystemLog
from surveys.questionnaires import store
from surveys.responses import Context, Respondent, begin
from tests.support.people import person
from tests.support.sessions import replays
from tests.support.studies import questionnaires
from tests.support.studies.studies import STUDY
from tests.support.studies.wizard_study import wizard_document

pytestmark = pytest.mark.django_db

# --- roles ----------------------------------------------------------------------------------------

ADMIN = {"administrator"}
VIEWERS = ADMIN | {"viewer", "researcher", "study_owner"}
RESEARCHERS = ADMIN | {"researcher", "study_owner"}
CODERS = RESEARCHERS | {"coder"}
STUDY_OWNER = ADMIN | {"study_owner"}
ROBOT_OWNER = ADMIN | {"robot_owner"}
PARTICIPANT = {"participant"}
ANY_OWNER = STUDY_OWNER | {"other_study_owner"}
WITH_A_STUDY = VIEWERS | {"other_study_owner"}
WITH_A_ROBOT = ROBOT_OWNER | {"other_robot_owner"}
STAFF = WITH_A_STUDY | WITH_A_ROBOT | {"staff"}
LOGGED_IN = STAFF | PARTICIPANT | {"visitor", "coder", "wizard"}
ALL = LOGGED_IN | {"stranger"}
NOBODY: set[str] = set()
EXCLUSION = {"exclude": "1", "reason": "because"}
OWNERS = "app_label=robots&model_name=robot&field_name=owner"

# Addresses that are the same for all users, or use other credentials; each has its own tests.
FOR_ALL = {
    *(
        "home",
        "setup",
        "robots_json",
        "about",
        "reference",
        "manifest",
        "set_language",
        "admin:login",
    ),
    *("screen", "screen_key", "agent_configuration", "agent_enrol", "agent_renew"),
    *("study_link", "study_invitation", "study_media", "study_code", "study_reminders_stop"),
    *("check", "practice", "practice_drive", "try_now", "try_robot", "demo-enter"),
    *("healthz", "readyz", "metrics"),
    *("api_robots", "api_robot", "api_act", "api_study", "api_participants"),
}


def people() -> dict:
    made = {name: person(name) for name in ("visitor", "participant", "coder", "wizard")}
    made |= {name: person(name, is_staff=True) for name in STAFF - ADMIN}
    return {
        "stranger": None,
        "administrator": person("administrator", is_staff=True, is_superuser=True),
        **made,
    }


def of_the_study(robot: Robot, participant) -> dict:
    """A published study with a participant who has driven, and a draft of its next version."""
    study = replays.study(
        status=Study.Status.PUBLISHED, definition={**STUDY, "slug": "cabin-study"}
    )
    draft = replays.study(version=2, definition={**STUDY, "version": 2})
    one = replays.participant(study, participant)
    visit = replays.session(robot, participant, seconds=60)
    drive = replays.drive(one, visit)
    consent = {"step": "consent", "version": 1, "language": "en", "text": "Yes"}
    ConsentReceipt.objects.create(participant=one, agreed_at=timezone.now(), **consent)
    codes = [{"code": "help", "name": "Help", "kind": "point"}]
    coding.store_scheme(study, coding.scheme_from(codes), timezone.now())
    rehearsal = Rehearsal.objects.create(study=study, sha256="0" * 64, began_at=timezone.now())
    return {
        "study": study,
        "draft": draft,
        "participation": one,
        "session": visit,
        "drive": drive,
        "rehearsal": rehearsal,
    }


@pytest.fixture
def world():
    """Everything that an address can name."""
    who = people()
    for role in ("coder", "viewer", "researcher", "owner"):
        StudyMember.objects.create(
            slug="cabin-study", user=who["study_owner" if role == "owner" else role], role=role
        )
    StudyMember.objects.create(slug="other-study", user=who["other_study_owner"], role="owner")
    replays.study(slug="other-study", definition={**STUDY, "slug": "other-study"})
    for role in ("coder", "wizard", "viewer", "researcher"):
        StudyMember.objects.create(slug="operated-study", user=who[role], role=role)
    operated = replays.study(
        slug="operated-study", definition=wizard_document(study={"slug": "operated-study"})
    )
    robot = replays.cabin_robot(owner=who["robot_owner"], access=Robot.Access.INVITATION)
    RobotPresence.objects.update(
        factsheet={
            **robot.presence.factsheet,
            "capabilities": ["velocity", "dock"],
            "limits": {"linear": 0.6, "angular": 0.7},
        }
    )
    other = {"owner": who["other_robot_owner"], "access": Robot.Access.INVITATION}
    Robot.objects.create(name="rhodon", title="Rhodon", **other)
    things = {
        "people": who,
        "robot": robot,
        "plan": FloorPlan.objects.get(),
        "operated": operated,
        **of_the_study(robot, who["participant"]),
    }
    things["photo"] = Snapshot.objects.create(
        session=things["session"], action_id="p", stamp=1.0, sha256="0" * 64, jpeg=b"jpeg"
    )
    things["questionnaire"] = store(
        questionnaires.defined([questionnaires.item("likert", "q1")]), timezone.now()
    )
    respondent, context = Respondent(user=who["participant"]), Context(key="k", return_to="/about/")
    things["response"] = begin(
        things["questionnaire"], respondent, context, language="en", seed=1, now=timezone.now()
    )
    things["lease"] = Lease.objects.create(robot=robot, changed_at=timezone.now())
    things["log"] = SystemLog.objects.create(at=timezone.now(), event="robot_online", robot=robot)
    things["api_key"] = ApiKey.objects.create(robot=robot, label="home", made_at=timezone.now())
    things["beat"] = ManagerBeat.objects.create(beat_at=timezone.now())
    things["link"] = links.make(things["study"], now=timezone.now())[0]
    return things


# --- the table ------------------------------------------------------------------------------------


def own_pages() -> list[tuple]:
    """(name, what it is given, who may, what is posted)."""
    return [
        ("profile", [], LOGGED_IN, None),
        ("own_data", [], LOGGED_IN, None),
        ("my_visits", [], LOGGED_IN, None),
        ("site_checks", [], ADMIN, None),
        ("own_data_download", [], LOGGED_IN, None),
        ("own_data_delete", [], LOGGED_IN, {"username": ""}),
        ("own_data_code", [], NOBODY, {}),
        ("drive", ["robot.name"], ROBOT_OWNER, None),
        ("snapshots", ["robot.name"], LOGGED_IN, None),
        ("snapshot", ["robot.name", "photo.pk"], PARTICIPANT, None),
        ("floor_plan", ["plan.name"], STAFF, None),
        ("floor_plan_image", ["plan.name"], STAFF, None),
        ("survey", ["response.pk"], PARTICIPANT, None),
        ("survey_page", ["response.pk", 1], PARTICIPANT, None),
        ("survey_page", ["response.pk", 1], PARTICIPANT, {"shown": "q1"}),
        ("survey_answer", ["response.pk"], PARTICIPANT, {"item": "q1"}),
        ("survey_done", ["response.pk"], PARTICIPANT, None),
        ("study", ["study.slug"], ALL, None),
        ("study_step", ["study.slug"], ALL, None),
        ("study_drive", ["study.slug"], ALL, None),
        ("study_appointment", ["study.slug"], ALL, None),
        ("study_return", ["study.slug"], ALL, None),
        ("study_withdraw", ["participation.code"], PARTICIPANT, None),
        ("study_withdraw", ["participation.code"], PARTICIPANT, {}),
        ("study_unshare", ["participation.code"], PARTICIPANT, {}),
        ("study_receipt", ["participation.code", "consent"], PARTICIPANT, None),
        ("withdrawal_receipt", [], NOBODY, {}),
    ]


def research_pages() -> list[tuple]:
    return [
        ("replay", ["session.pk"], VIEWERS, None),
        ("replay_data", ["session.pk"], VIEWERS, None),
        ("replay_photo", ["session.pk", "photo.pk"], RESEARCHERS, None),
        ("study_live", ["study.slug"], VIEWERS, None),
        ("study_live_data", ["study.slug"], VIEWERS, None),
        ("study_live_act", ["study.slug"], RESEARCHERS, {"act": "dance"}),
        ("study_wizard", ["operated.slug"], ADMIN | {"researcher", "wizard"}, None),
        ("study_wizard", ["study.slug"], RESEARCHERS, None),
        ("study_coding", ["study.slug"], VIEWERS | {"coder"}, None),
        ("coding_scheme", ["study.slug"], RESEARCHERS, {}),
        ("code_session", ["session.pk"], CODERS, None),
        ("coding_record", ["session.pk"], CODERS, None),
        ("coding_events", ["session.pk"], CODERS, None),
        ("coding_save", ["session.pk"], CODERS, {}),
        ("coding_done", ["session.pk"], CODERS, {}),
        ("coding_import", ["session.pk"], CODERS, {}),
        ("coding_eaf", ["session.pk"], CODERS, None),
        ("coding_boris", ["session.pk"], CODERS, None),
        ("study_analysis", ["study.pk"], VIEWERS, None),
        ("analysis", ["study.slug"], VIEWERS, None),
        ("analysis_topic", ["study.slug", "outcomes"], VIEWERS, None),
        ("analysis_export", ["study.slug"], VIEWERS, None),
        ("analysis_table", ["study.slug", "table5"], VIEWERS, None),
        ("analysis_sessions", ["study.slug", 0], VIEWERS, None),
        ("analysis_file", ["study.slug", "tables", "t.csv"], VIEWERS, None),
        ("analysis_deposit", ["study.slug"], STUDY_OWNER, {"to": "zenodo", "token": ""}),
        ("analysis_dataset", ["study.slug"], VIEWERS, None),
        ("analysis_dataset?free_text=1", ["study.slug"], RESEARCHERS, None),
        ("analysis_dataset?snapshots=1", ["study.slug"], RESEARCHERS, None),
        ("analysis_dataset?identified=1", ["study.slug"], STUDY_OWNER, None),
    ]


def study_pages() -> list[tuple]:
    study = [
        ("export", [], VIEWERS, None),
        ("section", ["steps"], VIEWERS, None),
        ("part", ["steps", 0], VIEWERS, None),
        ("check", ["courses", 0], VIEWERS, {}),
        ("members", [], VIEWERS, None),
        ("hours", [], VIEWERS, None),
        ("publication", [], VIEWERS, None),
        ("links", [], RESEARCHERS, None),
        ("recruitment", [], RESEARCHERS, None),
        ("payments", [], RESEARCHERS, None),
        ("walk_through", [], VIEWERS, None),
        ("walked_step", ["en", 1], VIEWERS, None),
        ("plan", [], VIEWERS, None),
        ("preregistration", [], VIEWERS, None),
        ("power", [], RESEARCHERS, {"participants": "few"}),
        ("deviations", [], STUDY_OWNER, {"deviations": "None."}),
        ("new_version", [], STUDY_OWNER, {}),
        ("close", [], STUDY_OWNER, {}),
        ("reopen", [], STUDY_OWNER, {}),
        ("publish", [], STUDY_OWNER, None),
        ("members", [], STUDY_OWNER, {"add": "1", "person": "staff", "role": "owner"}),
        ("hours", [], STUDY_OWNER, {"time_zone": "UTC"}),
        ("publication", [], STUDY_OWNER, {"doi": "10.1000/182"}),
        ("copy", [], STUDY_OWNER, None),
        ("links", [], RESEARCHERS, {"make": "1", "count": "1", "access": "open"}),
        ("recruitment", [], RESEARCHERS, {"label": "payments"}),
    ]
    draft = [
        ("section", ["about"], STUDY_OWNER, {"do": "save"}),
        ("section", ["steps"], STUDY_OWNER, {"do": "add:practice"}),
        ("part", ["steps", 0], STUDY_OWNER, {"do": "save"}),
        ("publish", [], STUDY_OWNER, {"reason": "because it is a test"}),
    ]
    lines = [
        (f"admin:experiments_study_{name}", ["study.pk", *args], who, data)
        for name, args, who, data in study
    ]
    lines += [
        (f"admin:experiments_study_{name}", ["draft.pk", *args], who, data)
        for name, args, who, data in draft
    ]
    return [
        *lines,
        ("admin:experiments_study_shipped", [], ADMIN, {"study": "exploration"}),
        ("admin:experiments_rehearsal_start", ["draft.pk"], STUDY_OWNER, {}),
        ("admin:experiments_rehearsal_end", ["rehearsal.pk"], STUDY_OWNER, {}),
        ("admin:experiments_rehearsal_state", ["rehearsal.pk"], VIEWERS, None),
        ("admin:experiments_rehearsal_report", ["rehearsal.pk"], VIEWERS, None),
        ("admin:experiments_participant_withdraw", ["participation.pk"], RESEARCHERS, None),
        ("admin:experiments_participant_withdraw", ["participation.pk"], RESEARCHERS, {"code": ""}),
        ("admin:experiments_drive_exclude", ["drive.pk"], RESEARCHERS, None),
        ("admin:experiments_drive_exclude", ["drive.pk"], RESEARCHERS, EXCLUSION),
    ]


def administration() -> list[tuple]:
    robot = [
        (name, ["robot.pk"], ROBOT_OWNER, data)
        for name in ("credentials", "doors", "screen", "enrol")
        for data in (None, {})
    ]
    return [
        ("admin:index", [], STAFF, None),
        ("admin:password_change", [], STAFF, None),
        ("admin:password_change_done", [], STAFF, None),
        ("admin:jsi18n", [], STAFF, None),
        ("admin:logout", [], STAFF, {}),
        ("admin:view_on_site", ["robot_type.pk", "robot.pk"], NOBODY, None),
        (f"admin:autocomplete?{OWNERS}", [], ADMIN, None),
        ("admin:auth_user_password_change", ["people.visitor.pk"], ADMIN, None),
        ("admin:app_list", ["robots"], WITH_A_ROBOT, None),
        ("admin:app_list", ["telepresence_sessions"], WITH_A_ROBOT, None),
        ("admin:app_list", ["experiments"], WITH_A_STUDY, None),
        ("admin:app_list", ["accounts"], ADMIN, None),
        ("admin:app_list", ["surveys"], ADMIN, None),
        *((f"admin:robots_robot_{name}", args, who, data) for name, args, who, data in robot),
        ("admin:robots_robot_status", ["robot.pk"], ROBOT_OWNER, None),
        ("admin:robots_robot_interventions", ["robot.pk"], ROBOT_OWNER, None),
        ("admin:robots_robot_interventions_csv", ["robot.pk"], ROBOT_OWNER, None),
        ("admin:telepresence_sessions_safety_test", ["robot.pk"], ROBOT_OWNER, None),
        ("admin:telepresence_sessions_safety_test", ["robot.pk"], ROBOT_OWNER, {"action": "start"}),
        ("admin:robots_floorplan_finish", ["plan.pk"], ADMIN, None),
        ("admin:robots_floorplan_finish", ["plan.pk"], ADMIN, {"action": "check"}),
        ("admin:telepresence_sessions_session_stop", ["session.pk"], ROBOT_OWNER, {}),
        ("admin:telepresence_sessions_session_states", ["session.pk", "csv"], ADMIN, None),
        ("admin:telepresence_sessions_snapshot", ["photo.pk"], ADMIN, None),
        ("admin:surveys_questionnaire_shipped", [], ADMIN, {}),
        ("admin:surveys_questionnaire_import", [], ADMIN, None),
        ("admin:surveys_questionnaire_import", [], ADMIN, {}),
        ("admin:surveys_questionnaire_import_save", [], ADMIN, {}),
        ("admin:surveys_questionnaire_preview", ["questionnaire.pk"], ADMIN, None),
        ("admin:surveys_questionnaire_export", ["questionnaire.pk"], ADMIN, None),
        ("admin:surveys_questionnaire_answers", ["questionnaire.pk", "long"], ADMIN, None),
        ("admin:surveys_questionnaire_new_version", ["questionnaire.pk"], ADMIN, {}),
        ("admin:surveys_questionnaire_write", [], ADMIN, None),
        ("admin:surveys_questionnaire_editor", ["questionnaire.pk"], ADMIN, None),
        ("admin:surveys_questionnaire_section", ["questionnaire.pk", "about"], ADMIN, None),
        ("admin:surveys_questionnaire_part", ["questionnaire.pk", "questions", "q1"], ADMIN, None),
        # a used questionnaire cannot be changed
        ("admin:surveys_questionnaire_editor", ["questionnaire.pk"], NOBODY, {}),
    ]


# By model: a row, and who sees the list, adds rows, sees the row, changes it, deletes it.
MODELS = {
    "auth_group": (None, ADMIN, ADMIN, NOBODY, NOBODY, NOBODY),
    "account_emailaddress": (None, ADMIN, ADMIN, NOBODY, NOBODY, NOBODY),
    "accounts_user": ("people.visitor", ADMIN, ADMIN, ADMIN, ADMIN, ADMIN),
    "accounts_auditentry": (None, ADMIN, NOBODY, NOBODY, NOBODY, NOBODY),
    "robots_robot": ("robot", WITH_A_ROBOT, ADMIN, ROBOT_OWNER, ROBOT_OWNER, ADMIN),
    "robots_robotelsewhere": (None, ADMIN, ADMIN, NOBODY, NOBODY, NOBODY),
    "robots_floorplan": ("plan", WITH_A_ROBOT, ADMIN, ROBOT_OWNER, ADMIN, ADMIN),
    "telepresence_sessions_session": ("session", WITH_A_ROBOT, NOBODY, ROBOT_OWNER, NOBODY, ADMIN),
    "telepresence_sessions_lease": ("lease", WITH_A_ROBOT, NOBODY, ROBOT_OWNER, NOBODY, NOBODY),
    "telepresence_sessions_systemlog": ("log", WITH_A_ROBOT, NOBODY, ROBOT_OWNER, NOBODY, NOBODY),
    "telepresence_sessions_managerbeat": ("beat", ADMIN, NOBODY, ADMIN, NOBODY, NOBODY),
    "telepresence_sessions_apikey": (
        "api_key",
        *[WITH_A_ROBOT] * 2,
        ROBOT_OWNER,
        NOBODY,
        ROBOT_OWNER,
    ),
    "surveys_questionnaire": ("questionnaire", ADMIN, ADMIN, ADMIN, NOBODY, ADMIN),
    "surveys_response": ("response", ADMIN, NOBODY, ADMIN, NOBODY, ADMIN),
    "experiments_participant": ("participation", WITH_A_STUDY, NOBODY, VIEWERS, NOBODY, NOBODY),
    "experiments_drive": ("drive", WITH_A_STUDY, NOBODY, VIEWERS, NOBODY, NOBODY),
    "experiments_rehearsal": ("rehearsal", WITH_A_STUDY, NOBODY, VIEWERS, NOBODY, NOBODY),
    "experiments_study": ("draft", WITH_A_STUDY, ANY_OWNER, VIEWERS, STUDY_OWNER, STUDY_OWNER),
}


def model_pages() -> list[tuple]:
    lines: list[tuple] = []
    for model, (row, lists, adds, looks, changes, deletes) in MODELS.items():
        there = [f"{row}.pk"] if row else [str(uuid.UUID(int=0))]
        lines += [
            (f"admin:{model}_changelist", [], lists, None),
            (f"admin:{model}_add", [], adds, None),
            (f"admin:{model}_change", there, looks, None),
            (f"admin:{model}_change", there, changes, {}),
            (f"admin:{model}_history", there, looks, None),
            (f"admin:{model}_delete", there, deletes, None),
        ]
    return lines


def table() -> list[tuple]:
    return [*own_pages(), *research_pages(), *study_pages(), *administration(), *model_pages()]


# --- asking ---------------------------------------------------------------------------------------


class Reached(Exception):
    """Access was granted, and the work of the page would take too long for this test."""


def address(name: str, args: list, world: dict) -> str:
    name, _, query = name.partition("?")
    return reverse(name, args=[found(arg, world) for arg in args]) + (f"?{query}" if query else "")


def found(arg, world: dict):
    """Return the value of a name such as "robot.name"."""
    first, *rest = str(arg).split(".")
    if first == "robot_type":
        return ContentType.objects.get_for_model(Robot).pk
    if first not in world or not rest:
        return arg
    value = world[first]
    for part in rest:
        value = value[part] if isinstance(value, dict) else getattr(value, part)
    return value


def lets_in(client: Client, url: str, data: dict | None) -> bool:
    """Request and roll back. A redirection to the log-in or the admin's first page is a refusal."""
    try:
        with transaction.atomic():
            answer = client.get(url) if data is None else client.post(url, data)
            transaction.set_rollback(True)
    except Reached:
        return True
    assert answer.status_code != 405, f"{url} is requested with the wrong method"
    assert answer.status_code != 500, url
    goes_to = answer.headers.get("Location", "").partition("?")[0]
    refusing = {reverse(name) for name in ("account_login", "admin:login", "admin:index")}
    return answer.status_code not in {401, 403, 404} and goes_to not in refusing


def names(resolver, space: str = "") -> set[str]:
    known: set[str] = set()
    for pattern in resolver.url_patterns:
        if hasattr(pattern, "url_patterns"):
            known |= names(pattern, space + (f"{pattern.namespace}:" if pattern.namespace else ""))
        elif pattern.name:
            known.add(space + pattern.name)
    return known


def test_table_lists_every_address_of_the_site():
    listed = {line[0].partition("?")[0] for line in table()} | FOR_ALL
    own = {name for name in names(get_resolver()) if not name.startswith("account_")}
    assert own - listed == set()


@pytest.mark.parametrize("role", sorted(ALL))
def test_each_role_can_open_exactly_what_the_table_allows(role, world, monkeypatch):
    def reached(*_args):
        raise Reached

    for module in ("analysis_views", "analysis_downloads"):
        monkeypatch.setattr(f"experiments.research.{module}.asked_of", reached)
    known, client, wrong = names(get_resolver()), Client(), []
    if world["people"][role] is not None:
        client.force_login(world["people"][role])
    cookies = client.cookies.copy()
    for name, args, allowed, data in table():
        if name.partition("?")[0] not in known:
            continue  # of a part of the site that is off
        client.cookies = cookies.copy()
        if lets_in(client, address(name, args, world), data) != (role in allowed):
            wrong.append(
                f"{role} {'is refused' if role in allowed else 'gets into'}"
                f" {'POST ' if data is not None else ''}{name}"
            )
    assert not wrong, "\n".join(wrong)
