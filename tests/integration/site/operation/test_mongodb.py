"""A site on MongoDB: migrations and checks without a server, and visits on the server that
MONGODB_URL names.
"""

import json
import os
import sys
import uuid

import pytest

from telepresence_site import mongodb
from tests.support.programs import finished

NOWHERE = "mongodb://127.0.0.1:1/telepresence?serverSelectionTimeoutMS=300"
MONGODB_URL = os.environ.get("MONGODB_URL", "")
NOT_GIVEN = (
    "NOT TESTED ON MONGODB: set MONGODB_URL to a server's address (no package of Debian or PyPI has"
    " one)"
)
# Visits on a real server: keys, unique constraints, JSON, binary data, compare and set, grouping.
SCENARIO = """
import datetime
from django.core.management import call_command
from django.db import connection
from django.db.models import Count
from django.utils import timezone
from accounts.models import User
from robots.models import FloorPlan, Robot, RobotPresence
from sessions.leases import store
from sessions.models import Session, StateChunk
from sessions.shards import rows
from telepresence_site.ops.metrics import _of_the_site
call_command("migrate", verbosity=0)
try:
    now = timezone.now()
    ada, bob = (
        User.objects.create_user(name, password="seven green kettles") for name in ("ada", "bob")
    )
    plan = FloorPlan.objects.create(
        name="p", title="P", resolution=0.05, origin_x=0, origin_y=0, width=1, height=1,
        image=bytes(range(256)),
    )
    robot = Robot.objects.create(
        name="giraff", title="Giraff", floor_plan=plan,
    )
    RobotPresence.objects.update(
        connection="ONLINE", last_seen_at=now, report={"battery": {"charge": 0.5}}
    )
    assert bytes(FloorPlan.objects.get().image) == bytes(range(256))
    first = store.take(robot, ada, "peer-a", now=now)
    assert isinstance(first, store.Granted), first
    assert isinstance(store.take(robot, bob, "peer-b", now=now), store.Queued)
    assert store.seen({first.session}, now) == {first.session}
    StateChunk.objects.bulk_create([
        StateChunk(
            session_id=first.session, boot="b", first_seq=n, last_seq=n, count=1,
            first_stamp=n, last_stamp=n, received_at=n, states=[{"n": n}],
        )
        for n in range(3)
    ])
    chunks = StateChunk.objects.filter(session=first.session).order_by("first_stamp")
    assert [chunk.first_seq for chunk in chunks] == [0, 1, 2]
    assert store.end(first.session, Session.Outcome.COMPLETED, "", now)
    assert rows.occupy(0, None, "here:1", now) and not rows.occupy(0, None, "there:2", now)
    assert rows.beat(0, "here:1", 2, now, {"connected": True})
    assert len(rows.holdings()) == 64
    rows.take_over([1, 2], [""], "here:1")
    assert [one.epoch for one in rows.holdings() if one.owner == "here:1"] == [1, 1]
    states = Session.objects.values_list("state").annotate(n=Count("pk")).order_by()
    assert dict(states) == {"ended": 1, "waiting": 1}
    assert len(_of_the_site(now)) > 8
    print("well")
finally:
    connection.database.client.drop_database(connection.settings_dict["NAME"])
"""


def run(*arguments, url=NOWHERE):
    environment = os.environ | {"DATABASE_URL": url, "HTTP_ONLY": "1"}
    environment["DJANGO_SETTINGS_MODULE"] = "telepresence_site.settings"
    done = finished.run(sys.executable, *arguments, env=environment)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_address_of_mongodb_is_recognized():
    assert mongodb.is_address("mongodb://db.example.org/robots")
    assert mongodb.is_address("mongodb+srv://db.example.org")
    assert not mongodb.is_address("postgres://db.example.org/robots")
    full = "mongodb://u:p@db.example.org:27017/robots?tls=true"
    assert mongodb.database(full)["NAME"] == "robots"
    assert mongodb.database("mongodb://db.example.org")["NAME"] == "telepresence"


@pytest.mark.nightly
def test_models_pass_the_checks_of_the_backend():
    assert "no issues" in run("manage.py", "check")


@pytest.mark.nightly
def test_migrations_are_complete_and_all_keys_can_be_made_by_mongodb():
    found = json.loads(run("-m", "tests.support.programs.mongodb_migrations"))
    assert found["vendor"] == "mongodb"
    assert found["missing"] == {}, (
        "python manage.py makemigrations, with DATABASE_URL naming a MongoDB"
    )
    kinds = {"ObjectIdAutoField", "UUIDField", "CharField", "OneToOneField"}
    assert set(found["keys"].values()) <= kinds
    assert "RunSQL" not in found["operations"]


@pytest.mark.skipif(not MONGODB_URL, reason=NOT_GIVEN)
def test_sessions_on_a_real_mongodb():
    base, _, options = MONGODB_URL.partition("?")
    host = "/".join(base.split("/")[:3])
    url = f"{host}/telepresence-test-{uuid.uuid4().hex[:12]}" + (f"?{options}" if options else "")
    code = f"import django; django.setup(); exec({SCENARIO!r})"
    assert run("-c", code, url=url).strip().endswith("well")
