"""Who may open which page and do what on it: every address of the site against every role, for
things that are theirs or not.

All things belong to one robot and one study. The robot's owner, the study's members and its
participant are asked, and people who are the same to another robot and another study, and so must
find nothing. An address that stands nowhere in this file fails the first test.
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

ADMINISTRATOR = {"administrator"}
VIEWERS = ADMINISTRATOR | {"viewer", "researcher", "study_owner"}
RESEARCHERS = ADMINISTRATOR | {"researcher", "study_owner"}
CODERS = RESEARCHERS | {"coder"}
STUDY_OWNER = ADMINISTRATOR | {"study_owner"}
ROBOT_OWNER = ADMINISTRATOR | {"robot_owner"}
PARTICIPANT = {"participant"}
WITH_A_STUDY = VIEWERS | {"other_study_owner"}
WITH_A_ROBOT = ROBOT_OWNER | {"other_robot_owner"}
STAFF = WITH_A_STUDY | WITH_A_ROBOT | {"staff"}
SIGNED_IN = STAFF | PARTICIPANT | {"visitor", "coder", "wizard"}
ALL = SIGNED_IN | {"stranger"}
NOBODY: set[str] = set()

# What is the same for everybody, or asks for something else than a person's session; each has tests
# of its own.
FOR_ALL = {
    "home",
    "robots_json",
    "about",
    "reference",
    "manifest",
    "set_language",
    "admin:login",
    "screen",
    "screen_key",
    "agent_configuration",
    "study_link",
    "study_invitation",
    "study_media",
    "study_code",
    "check",
    "practice",
    "try_now",
    "try_robot",
    "practice_drive",
    "healthz",
    "readyz",
    "metrics",
    "demo-enter",
    "agent_enrol",
    "agent_renew",
    "api_robots",
    "api_robot",
    "api_act",
    "api_study",
    "api_participants",
    "study_reminders_stop",
}


def people() -> dict:
    made = {name: person(name) for name in ("visitor", "participant", "coder", "wizard")}
    made |= {name: person(name, is_staff=True) for name in STAFF - ADMINISTRATOR}
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
    ConsentReceipt.objects.create(
        participant=one,
        step="consent",
        version=1,
        language="en",
        text="Yes",
        agreed_at=timezone.now(),
    )
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
    Robot.objects.create(
        name="rhodon",
        title="Rhodon",
        owner=who["other_robot_owner"],
        access=Robot.Access.INVITATION,
    )
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
        ("profile", [], SIGNED_IN, None),
        ("own_data", [], SIGNED_IN, None),
        ("own_data_download", [], SIGNED_IN, None),
        ("own_data_delete", [], SIGNED_IN, {"username": ""}),
        ("own_data_code", [], NOBODY, {}),
        ("drive", ["robot.name"], ROBOT_OWNER, None),
        ("snapshots", ["robot.name"], SIGNED_IN, None),
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
        ("study_wizard", ["operated.slug"], ADMINISTRATOR | {"researcher", "wizard"}, None),
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
        ("admin:experiments_study_shipped", [], ADMINISTRATOR, {"study": "exploration"}),
        ("admin:experiments_rehearsal_start", ["draft.pk"], STUDY_OWNER, {}),
        ("admin:experiments_rehearsal_end", ["rehearsal.pk"], STUDY_OWNER, {}),
        ("admin:experiments_rehearsal_state", ["rehearsal.pk"], VIEWERS, None),
        ("admin:experiments_rehearsal_report", ["rehearsal.pk"], VIEWERS, None),
        ("admin:experiments_participant_withdraw", ["participation.pk"], RESEARCHERS, None),
        ("admin:experiments_participant_withdraw", ["participation.pk"], RESEARCHERS, {"code": ""}),
        ("admin:experiments_drive_exclude", ["drive.pk"], RESEARCHERS, None),
        (
            "admin:experiments_drive_exclude",
            ["drive.pk"],
            RESEARCHERS,
            {"exclude": "1", "reason": "because"},
        ),
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
        (
            "admin:autocomplete?app_label=robots&model_name=robot&field_name=owner",
            [],
            ADMINISTRATOR,
            None,
        ),
        ("admin:auth_user_password_change", ["people.visitor.pk"], ADMINISTRATOR, None),
        ("admin:app_list", ["robots"], WITH_A_ROBOT, None),
        ("admin:app_list", ["telepresence_sessions"], WITH_A_ROBOT, None),
        ("admin:app_list", ["experiments"], WITH_A_STUDY, None),
        ("admin:app_list", ["accounts"], ADMINISTRATOR, None),
        ("admin:app_list", ["surveys"], ADMINISTRATOR, None),
        *((f"admin:robots_robot_{name}", args, who, data) for name, args, who, data in robot),
        ("admin:robots_robot_status", ["robot.pk"], ROBOT_OWNER, None),
        ("admin:robots_floorplan_finish", ["plan.pk"], ADMINISTRATOR, None),
        ("admin:robots_floorplan_finish", ["plan.pk"], ADMINISTRATOR, {"action": "check"}),
        ("admin:telepresence_sessions_session_stop", ["session.pk"], ROBOT_OWNER, {}),
        ("admin:telepresence_sessions_session_states", ["session.pk", "csv"], ADMINISTRATOR, None),
        ("admin:telepresence_sessions_snapshot", ["photo.pk"], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_shipped", [], ADMINISTRATOR, {}),
        ("admin:surveys_questionnaire_import", [], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_import", [], ADMINISTRATOR, {}),
        ("admin:surveys_questionnaire_import_save", [], ADMINISTRATOR, {}),
        ("admin:surveys_questionnaire_preview", ["questionnaire.pk"], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_export", ["questionnaire.pk"], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_answers", ["questionnaire.pk", "long"], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_new_version", ["questionnaire.pk"], ADMINISTRATOR, {}),
        ("admin:surveys_questionnaire_write", [], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_editor", ["questionnaire.pk"], ADMINISTRATOR, None),
        ("admin:surveys_questionnaire_section", ["questionnaire.pk", "about"], ADMINISTRATOR, None),
        (
            "admin:surveys_questionnaire_part",
            ["questionnaire.pk", "questions", "q1"],
            ADMINISTRATOR,
            None,
        ),
        # nobody changes what is in use
        ("admin:surveys_questionnaire_editor", ["questionnaire.pk"], NOBODY, {}),
    ]


# By model: which row, who sees lists, adds, looks at the row, changes it, deletes it.
MODELS = {
    "auth_group": (None, ADMINISTRATOR, ADMINISTRATOR, NOBODY, NOBODY, NOBODY),
    "account_emailaddress": (None, ADMINISTRATOR, ADMINISTRATOR, NOBODY, NOBODY, NOBODY),
    "account_emailconfirmation": (None, ADMINISTRATOR, ADMINISTRATOR, NOBODY, NOBODY, NOBODY),
    "accounts_user": (
        "people.visitor",
        ADMINISTRATOR,
        ADMINISTRATOR,
        ADMINISTRATOR,
        ADMINISTRATOR,
        ADMINISTRATOR,
    ),
    "accounts_auditentry": (None, ADMINISTRATOR, NOBODY, NOBODY, NOBODY, NOBODY),
    "robots_robot": ("robot", WITH_A_ROBOT, ADMINISTRATOR, ROBOT_OWNER, ROBOT_OWNER, ADMINISTRATOR),
    "robots_robotelsewhere": (None, ADMINISTRATOR, ADMINISTRATOR, NOBODY, NOBODY, NOBODY),
    "robots_floorplan": (
        "plan",
        WITH_A_ROBOT,
        ADMINISTRATOR,
        ROBOT_OWNER,
        ADMINISTRATOR,
        ADMINISTRATOR,
    ),
    "telepresence_sessions_session": (
        "session",
        WITH_A_ROBOT,
        NOBODY,
        ROBOT_OWNER,
        NOBODY,
        ADMINISTRATOR,
    ),
    "telepresence_sessions_lease": ("lease", WITH_A_ROBOT, NOBODY, ROBOT_OWNER, NOBODY, NOBODY),
    "telepresence_sessions_systemlog": ("log", WITH_A_ROBOT, NOBODY, ROBOT_OWNER, NOBODY, NOBODY),
    "telepresence_sessions_managerbeat": (
        "beat",
        ADMINISTRATOR,
        NOBODY,
        ADMINISTRATOR,
        NOBODY,
        NOBODY,
    ),
    "telepresence_sessions_apikey": (
        "api_key",
        WITH_A_ROBOT,
        WITH_A_ROBOT,
        ROBOT_OWNER,
        NOBODY,
        ROBOT_OWNER,
    ),
    "surveys_questionnaire": (
        "questionnaire",
        ADMINISTRATOR,
        ADMINISTRATOR,
        ADMINISTRATOR,
        NOBODY,
        ADMINISTRATOR,
    ),
    "surveys_response": ("response", ADMINISTRATOR, NOBODY, ADMINISTRATOR, NOBODY, ADMINISTRATOR),
    "experiments_participant": ("participation", WITH_A_STUDY, NOBODY, VIEWERS, NOBODY, NOBODY),
    "experiments_drive": ("drive", WITH_A_STUDY, NOBODY, VIEWERS, NOBODY, NOBODY),
    "experiments_rehearsal": ("rehearsal", WITH_A_STUDY, NOBODY, VIEWERS, NOBODY, NOBODY),
    "experiments_study": (
        "draft",
        WITH_A_STUDY,
        STUDY_OWNER | {"other_study_owner"},
        VIEWERS,
        STUDY_OWNER,
        STUDY_OWNER,
    ),
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
    """The page was let in, and what it would work out takes too long for this test."""


def address(name: str, args: list, world: dict) -> str:
    name, _, query = name.partition("?")
    return reverse(name, args=[found(arg, world) for arg in args]) + (f"?{query}" if query else "")


def found(arg, world: dict):
    """Return what "robot.name" stands for."""
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
    """Ask, and take back what was done; whoever is sent to the log-in, or to the administration's
    first page, was not let in.
    """
    try:
        with transaction.atomic():
            answer = client.get(url) if data is None else client.post(url, data)
            transaction.set_rollback(True)
    except Reached:
        return True
    assert answer.status_code != 405, f"{url} is asked in the wrong way"
    assert answer.status_code != 500, url
    goes_to = answer.headers.get("Location", "").partition("?")[0]
    return answer.status_code not in {401, 403, 404} and goes_to not in {
        reverse("account_login"),
        reverse("admin:login"),
        reverse("admin:index"),
    }


def names(resolver, space: str = "") -> set[str]:
    known: set[str] = set()
    for pattern in resolver.url_patterns:
        if hasattr(pattern, "url_patterns"):
            known |= names(pattern, space + (f"{pattern.namespace}:" if pattern.namespace else ""))
        elif pattern.name:
            known.add(space + pattern.name)
    return known


def test_every_address_of_the_site_stands_in_the_table():
    told = {line[0].partition("?")[0] for line in table()} | FOR_ALL
    assert {
        name for name in names(get_resolver()) if not name.startswith("account_")
    } - told == set()


@pytest.mark.parametrize("role", sorted(ALL))
def test_each_role_opens_what_the_table_says_and_nothing_else(role, world, monkeypatch):
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
            continue  # of a part of the site that is not there
        client.cookies = cookies.copy()
        if lets_in(client, address(name, args, world), data) != (role in allowed):
            wrong.append(
                f"{role} {'is refused' if role in allowed else 'gets into'}"
                f" {'POST ' if data is not None else ''}{name}"
            )
    assert not wrong, "\n".join(wrong)
