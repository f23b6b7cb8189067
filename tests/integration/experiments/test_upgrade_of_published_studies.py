"""An upgrade changes no study that was published before, and keeps what was recorded."""

import datetime
import json

import pytest
from django.db import connection
from django.db.migrations.executor import MigrationExecutor

from experiments.definition.schema import as_stored, digest
from experiments.models import Draw, Drive, FrozenStudyError, Participant, Rehearsal, Study
from tests.support.paths import ROOT
from tests.support.people import person
from tests.support.robots import create_robot

BEFORE = [("experiments", "0016_invitations_and_media")]
GOLDEN = ROOT / "tests" / "golden"
OLD = json.loads((GOLDEN / "study_published_before.json").read_text("utf-8"))
COMPLETE = json.loads((GOLDEN / "study_complete.json").read_text("utf-8"))
GRANTED = datetime.datetime(2026, 5, 4, 9, 0, tzinfo=datetime.UTC)


def study_before(models, status: str):
    version = 1 if status == "published" else 2
    definition = OLD["definition"] | {"version": version}
    return models.get_model("experiments", "Study").objects.create(
        slug="assistance",
        version=version,
        title="Assistance",
        definition=definition,
        sha256=OLD["sha256"] if version == 1 else "d" * 64,
        status=status,
        created_at=GRANTED,
    )


def drive_before(models, participant, robot, **more):
    """A drive as the release before stored it: `more` of the drive, and `frame` the time when the
    page reported its first frame, in Unix seconds.
    """
    frame = more.pop("frame", None)
    session = models.get_model("telepresence_sessions", "Session").objects.create(
        robot_id=robot.pk,
        visitor_id=participant.user_id,
        live_key=str(more["number"]),
        queued_at=GRANTED,
        granted_at=GRANTED,
        first_motion_at=more.pop("first_motion_at", None),
        state="ended",
    )
    if frame is not None:
        models.get_model("telepresence_sessions", "SessionEvent").objects.create(
            session=session, source="page", type="first_frame", stamp=frame, received_at=frame
        )
    return models.get_model("experiments", "Drive").objects.create(
        participant=participant,
        session=session,
        step="task",
        visit=1,
        round=0,
        condition="alone",
        seed=1,
        granted_at=GRANTED,
        assigned={"condition": OLD["definition"]["conditions"][0], "start": {}},
        **more,
    )


def upgrade() -> None:
    """Store what the release before stored, and have the site upgraded."""
    robot, user = create_robot(name="giraff", title="Giraff"), person("ada")
    newest = MigrationExecutor(connection).loader.graph.leaf_nodes()
    try:
        MigrationExecutor(connection).migrate(BEFORE)
        models = MigrationExecutor(connection).loader.project_state(BEFORE).apps
        study, draft = (study_before(models, status) for status in ("published", "draft"))
        models.get_model("experiments", "Rehearsal").objects.create(
            study=draft, sha256=draft.sha256, began_at=GRANTED, passed=True, live_key="r"
        )
        people = models.get_model("experiments", "Participant").objects
        order = {"cell": "alone-assisted", "conditions": ["alone", "assisted"], "stage": "filled"}
        for n, cell in enumerate((order, order, {})):
            people.create(
                study=study,
                user_id=user.pk if n == 0 else None,
                slot=f"slot-{n}",
                code=f"P{n}",
                drawn_as=f"{study.pk}:participant:{7 - n}",
                draw_seed=n,
                candidates=["alone-assisted"],
                assigned_at=GRANTED,
                created_at=GRANTED,
                seen_at=GRANTED,
                **cell,
            )
        who, seen = people.get(code="P0"), GRANTED.timestamp() + 4.0
        drive_before(models, who, robot, number=1, exposed=False, frame=seen)
        moved = GRANTED + datetime.timedelta(seconds=9)
        drive_before(models, who, robot, number=2, exposed=True, first_motion_at=moved)
        drive_before(models, who, robot, number=3, exposed=False)
    finally:  # the next tests have this database, too
        MigrationExecutor(connection).migrate(newest)


@pytest.mark.django_db(transaction=True)
def test_an_upgrade_keeps_what_published_studies_mean_and_what_was_recorded():
    upgrade()
    published, draft = Study.objects.order_by("version")
    check_published_study(published)
    assert draft.sha256 == digest(draft.as_definition())
    assert Rehearsal.objects.get().sha256 == draft.sha256
    rows = Draw.objects.order_by("number").values_list("participant__code", "number", "cell")
    assert list(rows) == [("P1", 6, "alone-assisted"), ("P0", 7, "alone-assisted")]
    applied = dict(Participant.objects.values_list("code", "draws_applied"))
    assert applied == {"P0": 1, "P1": 1, "P2": 0}
    check_exposures(*Drive.objects.order_by("number"))


def check_published_study(study: Study) -> None:
    assert study.definition == COMPLETE["definition"]
    assert study.sha256 == OLD["sha256"]
    assert study.as_definition().allocation.best_probability == 1.0
    study.title = "Assistance 2026"
    study.save()
    study.definition = as_stored(study.as_definition()) | {"recruitment": "by e-mail"}
    with pytest.raises(FrozenStudyError):
        study.save()


def check_exposures(seen: Drive, moved: Drive, nothing: Drive) -> None:
    assert (seen.exposed_at - GRANTED).total_seconds() == 4.0
    assert (moved.exposed_at - GRANTED).total_seconds() == 9.0
    assert (seen.moved, moved.moved, nothing.exposed_at) == (False, True, None)
    whole = COMPLETE["definition"]["conditions"][0]
    assert seen.assigned == {"condition": whole, "start": COMPLETE["definition"]["start"]}
