"""A hidden operator's page and socket, with a bridge in memory and a real database: who gets in,
what is driven, recorded and published, and what is kept secret.
"""

import asyncio

import msgspec
import pytest
from asgiref.sync import sync_to_async
from channels.layers import get_channel_layer
from django.urls import reverse
from django.utils import timezone

from experiments import publishing
from experiments.extraction.build import release_of
from experiments.extraction.events import events_of
from experiments.extraction.selection import Selection
from experiments.models import Drive, Participant, StudyMember
from experiments.participation import progress
from experiments.participation.own_data.gathering import gather
from experiments.research import live
from robots.api import messages as m
from robots.bridge import bridge as mqtt_bridge
from robots.models import Robot
from sessions import page_channel, protocol as pages
from sessions.leases.store import change_lease
from sessions.models import Lease, SessionEvent
from sessions.wizard import protocol
from sessions.wizard.leases import note
from tests.integration.experiments.test_publishing import NOW
from tests.support import words
from tests.support.browsers.html_page import read
from tests.support.browsers.pages import SECONDS, Page, until
from tests.support.browsers.wizard_console import Console
from tests.support.patience import patient
from tests.support.people import person
from tests.support.sessions.memory_bridge import MemoryBridge
from tests.support.studies import participants as p
from tests.support.studies.studies import STUDY, small_study
from tests.support.studies.study_site import ALL, cabin_with_giraff
from tests.support.studies.wizard_study import OPERATOR_TEXT, wizard_study

pytestmark = pytest.mark.django_db
# A socket asks the database in a thread of its own; emptying all tables afterwards takes long.
sockets = pytest.mark.django_db(transaction=True)


@pytest.fixture
def bridge():
    double = MemoryBridge()
    double.stored["giraff", "connection"] = msgspec.json.encode(words.online())
    double.stored["giraff", "factsheet"] = msgspec.json.encode(words.factsheet())
    mqtt_bridge.use(double)
    yield double
    mqtt_bridge.use(None)


@pytest.fixture
def robot(db):
    cabin_with_giraff()
    robot = Robot.objects.get(name="giraff")
    robot.presence.factsheet["capabilities"] = [*ALL, "say"]
    robot.presence.connection = "ONLINE"
    robot.presence.save()
    return robot


@pytest.fixture
def study(robot):
    named = [
        {**one, "key": f"zeta_{one['key']}", "title": {"en": "Zeta"}} for one in STUDY["conditions"]
    ]
    return p.published(wizard_study(study={"conditions": named}))


@pytest.fixture
def operator(study):
    user = person("operator")
    StudyMember.objects.create(slug=study.slug, user=user, role=StudyMember.Role.WIZARD)
    return user


@pytest.fixture
def participant(study):
    return p.comer(study, person("participant"))


def events(kind):
    return list(SessionEvent.objects.filter(type=kind).values_list("data", flat=True))


def velocity(seq=1, **fields):
    values = {"linear": 0.2, "angular": 0.0, "method": "keyboard"} | fields
    return m.VelocityCommand(session="x", epoch=0, seq=seq, stamp=1.0, **values)


def sent_to_robot(bridge, kind):
    return [message for _, _, message in bridge.sent if isinstance(message, kind)]


async def recorded(kind, count=1):
    async with asyncio.timeout(patient(SECONDS)):
        while len(found := await sync_to_async(events)(kind)) < count:
            await asyncio.sleep(0.01)
    return found


@sockets
async def test_the_operator_drives_and_speaks_and_the_participant_does_not_drive(
    bridge, operator, participant
):
    async with Page("giraff", participant.user) as page, Console("giraff", operator) as console:
        granted = await page.take()
        assert granted.terms.controllers == ()
        assert bridge.leases[-1][1].driver is None
        scene, wheel = await console.operate()
        lease = bridge.leases[-1][1]
        assert (lease.kind, lease.session, lease.wizard_epoch) == (
            "wizard",
            granted.session,
            wheel.epoch,
        )
        assert lease.driver == console.told("wizard/hello")[0].peer
        assert (lease.peer, lease.ways, lease.methods) == (granted.peer, ("mqtt",), None)

        await page.say("command/velocity", velocity())
        await page.expect("denied", lambda denied: denied.reason == "not_driver")
        await console.say("command/velocity", velocity())
        step = protocol.BeginStep(step="hello", action_id="a1", stamp=2.0)
        await console.say("wizard/step", step)
        assert (await console.expect("wizard/begun")).reason == ""
        (moved,) = sent_to_robot(bridge, m.VelocityCommand)
        (spoken,) = sent_to_robot(bridge, m.Say)
        assert (moved.session, moved.epoch) == (granted.session, wheel.epoch)
        assert (spoken.text, spoken.role, spoken.epoch) == (
            "Hello, I am the robot.",
            "driver",
            wheel.epoch,
        )
        assert scene.participant == participant.code


@sockets
async def test_the_operator_is_recorded_with_every_step_deviation_and_latency(
    bridge, operator, participant
):
    async with Page("giraff", participant.user) as page, Console("giraff", operator) as console:
        await page.take()
        await console.operate()
        for number, key in enumerate(("hello", "leave", "look")):
            await console.say(
                "wizard/step", protocol.BeginStep(step=key, action_id=f"a{number}", stamp=2.0)
            )
        await console.say("wizard/line", protocol.FreeLine(text="Mm", action_id="a4", stamp=2.0))
        await console.say("wizard/reached", protocol.Reached(action_id="a0", latency=0.0421))
        await console.say("command/velocity", velocity())
        steps = await recorded("wizard_step", 3)
        assert [(one["step"], one["deviation"], one["skipped"]) for one in steps] == [
            ("hello", "", 0),
            ("leave", "out_of_order", 1),
            ("look", "out_of_order", 0),
        ]
        assert (await recorded("wizard_line"))[0]["text"] == "Mm"
        assert (await recorded("wizard_reached"))[0]["latency"] == 0.0421
        assert (await recorded("wizard_by_hand"))[0]["method"] == "keyboard"
        assert (await recorded("wizard_took"))[0]["blind"] is True
    await sync_to_async(_leaves_as_a_pseudonym)(operator)


def _leaves_as_a_pseudonym(operator):
    drive = Drive.objects.get()
    study = drive.participant.study
    events = events_of([drive], release_of(study, Selection()))
    rows = [row for row in events if row.type.startswith("wizard_")]
    assert {row.data["by"] for row in rows} != {str(operator.pk)}
    assert len({row.data["by"] for row in rows}) == 1
    assert str(operator.pk) not in repr(rows)
    assert "Mm" not in repr(rows)
    assert {row.data.get("step") for row in rows} >= {"hello", "leave", "look"}


@sockets
async def test_a_lost_console_stops_the_robot_and_is_shown_to_researchers(
    bridge, operator, participant, study
):
    async with Page("giraff", participant.user) as page:
        granted = await page.take()
        async with Console("giraff", operator) as console:
            await console.operate()
            await console.say("command/velocity", velocity(seq=7))
            await until(lambda: sent_to_robot(bridge, m.VelocityCommand))
        stop = bridge.stops[-1][1]
        assert (stop.role, stop.session, stop.seq) == ("driver", granted.session, 7)
        await until(lambda: bridge.leases[-1][1].driver is None)
        await recorded("wizard_lost")
        (drive,) = (await sync_to_async(live.now_in)(study.slug, timezone.now()))["drives"]
        assert drive["wizard"]["status"] == "lost"
        # the participant's session goes on, and the next operator drives
        assert not page.told("session/ended")
        async with Console("giraff", operator) as again:
            _, wheel = await again.operate()
            assert bridge.leases[-1][1].wizard_epoch == wheel.epoch
        assert "wizard" not in repr(page.seen)


@sockets
async def test_of_two_operators_one_drives(bridge, operator, participant, study):
    other = await sync_to_async(person)("researcher")
    member = StudyMember(slug=study.slug, user=other, role=StudyMember.Role.RESEARCHER)
    await sync_to_async(member.save)()
    async with (
        Page("giraff", participant.user) as page,
        Console("giraff", operator) as first,
        Console("giraff", other) as second,
    ):
        granted = await page.take()
        await first.operate()
        await second.expect("wizard/session", lambda scene: scene.operator == "other")
        await second.say("wizard/take", protocol.TakeOver(session=granted.session))
        assert (await second.expect("wizard/lost")).reason == "occupied"
        await second.say("wizard/take", protocol.TakeOver(session=granted.session, takeover=True))
        wheel = await second.expect("wizard/granted")
        assert (await first.expect("wizard/lost")).reason == "taken"
        await first.say("command/velocity", velocity())
        await first.expect("denied", lambda denied: denied.suffix == "command/velocity")
        await second.say("command/velocity", velocity())
        await until(lambda: sent_to_robot(bridge, m.VelocityCommand))
        assert {one.epoch for one in sent_to_robot(bridge, m.VelocityCommand)} == {wheel.epoch}


@sockets
async def test_a_blind_operator_cannot_see_the_condition(bridge, operator, participant, client):
    state = words.state(boot="b1", assist="steer", mode="assisted")
    async with Page("giraff", participant.user) as page, Console("giraff", operator) as console:
        await page.take()
        await console.operate()
        lab = m.LabReport(lab=m.NetworkLab(delay=0.123))
        bridge.say("giraff", "state", msgspec.structs.replace(state, control_network=lab))
        await console.expect("wizard/state")
        frames = "\n".join(console.frames)
    await sync_to_async(client.force_login)(operator)
    html = (await sync_to_async(client.get)("/studies/cabin-study/wizard/")).content.decode()
    assert (await sync_to_async(Drive.objects.get)()).condition.startswith("zeta_")
    for word in ("zeta", "Zeta", "steer", "assisted", "0.123"):
        assert word not in frames
        assert word not in html
    for address in ("live/", "live.json", "live/act/"):
        answer = await sync_to_async(client.get)(f"/studies/cabin-study/{address}")
        assert answer.status_code in {404, 405}


@pytest.mark.parametrize("role", [None, StudyMember.Role.VIEWER])
def test_only_operators_open_the_page(client, study, role):
    user = person("somebody")
    if role is not None:
        StudyMember.objects.create(slug=study.slug, user=user, role=role)
    client.force_login(user)
    assert client.get(f"/studies/{study.slug}/wizard/").status_code == 404


@sockets
async def test_only_operators_open_the_socket(bridge, study, participant):
    console = Console("giraff", participant.user)
    await console.open()
    assert await console.closed() == pages.NOT_ALLOWED


@sockets
@pytest.mark.parametrize("loss", ["another role", "no role"])
async def test_an_operator_who_loses_the_role_leaves_at_once(
    bridge, operator, participant, study, loss
):
    member = await StudyMember.objects.aget(slug=study.slug, user=operator)
    async with Page("giraff", participant.user) as page, Console("giraff", operator) as console:
        await page.take()
        await console.operate()
        group = page_channel.visitor_group(operator.pk)
        await until(lambda: get_channel_layer().groups.get(group))
        if loss == "no role":
            await member.adelete()
        else:
            member.role = StudyMember.Role.VIEWER
            await member.asave()
        async with asyncio.timeout(patient(SECONDS)):
            assert await console.closed() == pages.NOT_ALLOWED


def test_the_debriefing_tells_of_the_operator_and_of_the_way_out(client, participant):
    participant.step, participant.conditions = "thanks", ["all_open"]
    participant.save()
    client.force_login(participant.user)
    page = client.get("/studies/cabin-study/step/").content.decode()
    assert OPERATOR_TEXT in page
    assert f"/taking-part/{participant.code}/withdraw/" in page


@pytest.mark.parametrize("kind", ["leaves", "deletes the account", "is turned away", "no drive"])
def test_participant_who_met_an_operator_is_told_however_they_leave(
    client, robot, participant, kind
):
    own = p.assign(participant, "all_open")
    if kind != "no drive":
        p.drive_of(robot, own, outcome="cancelled", moved=False)
    client.force_login(own.user)
    if kind == "is turned away":
        progress.screen_out(own, timezone.now())
        page = client.get("/studies/cabin-study/step/")
    elif kind == "deletes the account":
        page = client.post(reverse("own_data_delete"), {"username": own.user.username}, follow=True)
    else:
        asked = client.get(f"/taking-part/{own.code}/withdraw/").content.decode()
        assert OPERATOR_TEXT not in asked, "those who stay are not told"
        page = client.post(f"/taking-part/{own.code}/withdraw/")
    assert (OPERATOR_TEXT in page.content.decode()) is (kind != "no drive")


def test_own_data_names_the_operator_role_after_the_debriefing_and_never_the_person(
    robot, participant, operator
):
    session = p.drive_of(robot, p.assign(participant, "zeta_all_open")).session
    note(str(session.pk), "wizard_took", operator, timezone.now(), blind=True)

    def own_events():
        return [one["type"] for one in gather(participant.user)["drives"][0]["events"]]

    assert "wizard_took" not in own_events()
    Participant.objects.update(completion="done")
    assert "wizard_took" in own_events()
    assert str(operator.pk) not in repr(gather(participant.user))


def test_a_lease_that_moves_to_another_session_forgets_its_operator(robot):
    Lease.objects.create(
        robot=robot, epoch=3, wizard_peer="w", wizard_epoch=5, changed_at=timezone.now()
    )
    assert change_lease(robot, 3, session=None, peer="", now=timezone.now())
    lease = Lease.objects.get()
    assert (lease.wizard_peer, lease.wizard_epoch) == ("", 5)


def test_page_states_that_a_study_has_no_hidden_operator(client):
    plain = publishing.store(small_study(slug="plain"), NOW)
    owner = person("olga", is_staff=True)
    StudyMember.objects.create(slug=plain.slug, user=owner, role=StudyMember.Role.OWNER)
    client.force_login(owner)
    page = read(client.get(f"/studies/{plain.slug}/wizard/"))
    assert "This study has no hidden operator" in page.text
    build = reverse("admin:experiments_study_section", args=[plain.pk, "wizard"])
    assert build in [a.attributes.get("href") for a in page.all("a")]
    assert client.get("/studies/nothing/wizard/").status_code == 404
