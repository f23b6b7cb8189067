"""Robots, credentials and floor plans in the administration."""

import datetime
import functools
import json
import re
import tomllib
from html import unescape
from urllib.parse import unquote

import pytest
from django.contrib.admin.models import LogEntry
from django.contrib.auth.models import Permission
from django.core.exceptions import ValidationError
from django.core.files.uploadedfile import SimpleUploadedFile
from django.utils import timezone

from robots.admin import RobotAdmin
from robots.enrol.credentials import robot_of
from robots.files import limited_process
from robots.files.limited_process import ChildLimits
from robots.forms import RobotForm
from robots.models import FloorPlan, Robot, RobotPermit, RobotPresence
from robots.plans.floorplans import MAX_PLAN, store_floor_plan
from robots.world.sites import SHIPPED
from sessions.models import Lease
from tests.support.architectures.installed_adapters import install
from tests.support.people import person
from tests.support.robots import (
    create_robot,
    create_robots,
    floor_plan,
    robot_form,
    unsaved_robot,
    update_robots,
)
from tests.support.sessions import replays

pytestmark = pytest.mark.django_db
LIST, ADD = "/admin/robots/robot/", "/admin/robots/robot/add/"
ADD_PLAN = "/admin/robots/floorplan/add/"
OFFICE = SHIPPED / "office"
YAML = (OFFICE / "map.yaml").read_bytes()
FORM = robot_form()
LAB = {"name": "lab", "title": "The lab"}


@pytest.fixture
def researcher(client):
    user = person("researcher", is_staff=True, is_superuser=True)
    client.force_login(user)
    return user


@pytest.fixture
def giraff():
    report = {"boot": "b1", "seq": 1, "battery": {"charge": 0.81, "charging": True}, "docked": True}
    return create_robot(
        name="giraff",
        title="The Giraff",
        connection="ONLINE",
        boot="b1",
        last_seen_at=timezone.now(),
        report=report,
        factsheet={"series": "Giraff", "rca": "<b>simulator</b>"},
    )


def page(client, address, **options):
    response = client.get(address, **options)
    assert response.status_code == 200
    return response.content.decode()


def posted(client, address, form=None, **options):
    return unescape(client.post(address, form, **options).content.decode())


def change_page(robot):
    return f"{LIST}{robot.pk}/change/"


def assert_clean(text):
    """Assert that the content security policy allows everything in a page."""
    assert not re.search(r"<style|\sstyle=|\son[a-z]+=", text)
    scripts = re.findall(r"<script[^>]*>", text)
    assert all("src=" in tag or 'type="application/json"' in tag for tag in scripts)


def test_practice_robots_are_neither_listed_nor_counted(client, researcher, giraff):
    office = store_floor_plan(OFFICE)
    Robot.objects.create(name="practice-1", title="Practice", practice=True, floor_plan=office)
    Robot.objects.filter(name="giraff").update(floor_plan=office)
    assert "practice-1" not in page(client, LIST)
    plans = client.get("/admin/robots/floorplan/").context["cl"].queryset
    assert [plan.robots_there for plan in plans] == [1]


def test_list_shows_the_state_of_each_robot(client, researcher, giraff):
    visitor = person("ada", display_name="Ada")
    session = replays.session(giraff, visitor, state="driving")
    Lease.objects.create(robot=giraff, session=session, epoch=3, changed_at=timezone.now())
    Robot.objects.create(name="rhodon", title="Rhodon")
    text = page(client, LIST)
    assert "81%, charging" in text
    assert "Ada" in text
    assert 'href="/robots/giraff/"' in text
    assert "giraff<" not in text  # the name in links, beside the title
    states = re.findall(r'<span class="state" data-tone="(\w+)">(.*?)</span>', text)
    assert states == [("busy", "In use"), ("off", "New")]
    assert 'alt="False"' not in text
    assert_clean(text)


def test_list_begins_with_robots_that_need_somebody(client, researcher, giraff):
    seen = timezone.now()
    here = {"connection": "ONLINE", "last_seen_at": seen + datetime.timedelta(hours=1)}
    create_robot(name="a-new", shown_to_visitors=False)
    create_robot(name="z-stopped", report={"safety": {"estop": True}}, **here)
    create_robot(name="y-stuck", turnaround="paused", turnaround_reason="not_docked", **here)
    create_robot(name="x-off", enabled=False)
    create_robot(name="w-away", last_seen_at=seen - datetime.timedelta(hours=30))
    answer = client.get(LIST)
    names = [robot.name for robot in answer.context["cl"].result_list]
    assert names == ["w-away", "z-stopped", "y-stuck", "giraff", "a-new", "x-off"]
    text = answer.content.decode()
    assert unescape(text).count(">1\xa0day ago<") == 1
    assert "it is not docked" in text
    by_title = client.get(LIST, {"o": "1"}).context["cl"].result_list
    assert by_title[0].name == "a-new"


def test_first_action_is_not_the_deletion(client, researcher, giraff):
    actions = re.search(r'<select name="action".*?</select>', page(client, LIST), re.DOTALL)[0]
    names = re.findall(r'value="(\w+)"', actions)
    assert names[-1] == "delete_selected"
    assert len(names) > 3


def test_deletion_page_does_not_list_presence_and_credentials(client, researcher, giraff):
    Robot.objects.create(name="rhodon", title="The Rhodon")
    delete = f"{LIST}{giraff.pk}/delete/"
    chosen = {"action": "delete_selected", "_selected_action": [str(giraff.pk)]}
    for text in (page(client, delete), posted(client, LIST, chosen)):
        assert "The Giraff" in text
        assert not re.search(r"robot presence|robot credentials|object \(", text, re.IGNORECASE)
    client.post(delete, {"post": "yes"})
    assert [robot.name for robot in Robot.objects.all()] == ["rhodon"]
    assert RobotPresence.objects.count() == 1


def test_number_of_queries_of_the_list_does_not_grow(
    client, researcher, giraff, django_assert_max_num_queries
):
    for number in range(20):
        Robot.objects.create(name=f"robot-{number}", title=f"Robot {number}")
    with django_assert_max_num_queries(14):
        client.get(LIST)


def test_page_of_a_long_list_reads_fifty_rows_and_no_map_images(
    client, researcher, giraff, django_assert_max_num_queries
):
    office = store_floor_plan(OFFICE)
    create_robots(
        *(unsaved_robot(name=f"many-{n}", title=f"Many {n}", floor_plan=office) for n in range(250))
    )
    with django_assert_max_num_queries(14) as asked:
        answer = client.get(LIST, {"q": "many", "enabled__exact": "1", "p": "2"})
    assert len(answer.context["cl"].result_list) == 50
    rows = [query["sql"] for query in asked if '"robots_robot"."title"' in query["sql"]]
    assert rows
    assert not any('"robots_floorplan"."image"' in sql for sql in rows)


def test_robots_are_found_and_filtered(client, researcher, giraff):
    Robot.objects.create(name="rhodon", title="Rhodon", access=Robot.Access.TRAINED)
    assert "The Giraff" not in page(client, LIST + "?q=rhodon")
    assert "The Giraff" not in page(client, LIST + "?access__exact=trained")


def test_robot_whose_last_message_is_old_is_not_online(client, researcher, giraff):
    RobotPresence.objects.update(last_seen_at=timezone.now() - datetime.timedelta(minutes=1))
    assert ">Offline</span>" in page(client, LIST)


def test_list_of_robots_is_sorted_by_status_and_filtered_by_online(client, researcher, giraff):
    now = timezone.now()
    old = now - datetime.timedelta(minutes=1)
    create_robot(name="silent", connection="ONLINE", last_seen_at=old)
    create_robot(name="off", connection="ONLINE", last_seen_at=now, enabled=False)
    create_robot(name="new")
    column = RobotAdmin.list_display.index("status") + 1
    for order, place in ((column, -1), (f"-{column}", 0)):
        listed = list(client.get(LIST, {"o": order}).context["cl"].result_list)
        assert len(listed) == 4
        assert listed[place].name == "giraff"
    found = client.get(LIST, {"now": "online", "o": column}).context["cl"].result_list
    assert [robot.name for robot in found] == ["giraff"]


def test_robots_page_shows_its_factsheet_and_cannot_rename_it(client, researcher, giraff):
    text = page(client, change_page(giraff))
    assert "&lt;b&gt;simulator&lt;/b&gt;" in text.replace("\\u003C", "&lt;")
    assert 'name="name"' not in text
    assert f"{LIST}{giraff.pk}/credentials/" in text
    assert giraff.credentials.credential_hash not in text or not giraff.credentials.credential_hash
    assert_clean(text)


def test_robots_page_shows_why_the_agent_does_not_reach_it(client, researcher, giraff):
    def control():
        field = r'field-control.*?class="readonly">(.*?)</div>'
        return re.search(field, page(client, change_page(giraff)), re.DOTALL)[1]

    assert control() == "responding"
    lost = {"errors": ["adapter_lost: no ROS master at http://robot:11311"]}
    RobotPresence.objects.update(report=giraff.presence.report | lost)
    assert control() == "no ROS master at http://robot:11311"
    RobotPresence.objects.update(connection="OFFLINE")
    assert control() == "–"


def test_new_robot_needs_a_valid_name(client, researcher):
    for bad in ("server", "Giraff", "a b", "-a", "a/b"):
        assert "errorlist" in posted(client, ADD, FORM | {"name": bad})
    assert client.post(ADD, FORM | {"name": "giraff-2"}).status_code == 302
    assert Robot.objects.get().name == "giraff-2"


@pytest.mark.parametrize("field", ["turn_minutes", "max_linear", "max_angular"])
def test_decimal_comma_is_accepted_in_spanish_only(client, researcher, giraff, field):
    address = change_page(giraff)
    assert "write 0.6, not 0,6" in posted(client, address, FORM | {field: "0,6"})
    for language, text, number in (("es", "0,6", 0.6), ("es", "0.7", 0.7), ("en", "0.8", 0.8)):
        spoken = {"headers": {"accept-language": language}}
        assert client.post(address, FORM | {field: text}, **spoken).status_code == 302
        assert getattr(Robot.objects.get(), field) == number
        shown = re.search(rf'<input[^>]*name="{field}"[^>]*>', page(client, address, **spoken))[0]
        separator = {"es": ",", "en": "."}[language]
        assert f'value="{str(number).replace(".", separator)}"' in shown
        assert 'type="text"' in shown
        assert 'inputmode="decimal"' in shown


def test_translations_of_a_robot_are_edited_and_deleted_on_its_page(client, researcher):
    form = FORM | {"name": "giraff-2"}
    spanish = {"title_es": "Jirafa", "description_es": "En el pasillo"}
    assert client.post(ADD, form | spanish).status_code == 302
    robot = Robot.objects.get()
    assert robot.translations == {"es": {"title": "Jirafa", "description": "En el pasillo"}}
    assert 'value="Jirafa"' in page(client, change_page(robot))
    robot.translations["fr"] = {"title": "Girafe"}
    robot.save()
    assert client.post(change_page(robot), form | {"title_es": "J"}).status_code == 302
    robot.refresh_from_db()
    assert robot.translations == {"es": {"title": "J"}, "fr": {"title": "Girafe"}}
    assert client.post(change_page(robot), form).status_code == 302
    robot.refresh_from_db()
    assert robot.translations == {"fr": {"title": "Girafe"}}


def test_new_robot_needs_a_name_and_its_kind_only(client, researcher):
    text = page(client, ADD)
    first = re.search(r'<fieldset class="module aligned[^"]*".*?</fieldset>', text, re.DOTALL)[0]
    assert re.findall(r'<(?:input|select|textarea)[^>]*\sname="(\w+)"', first) == [
        "title", "name", "adapter", "adapter_other", "profile", "profile_other"
    ]  # fmt: skip
    assert text.count("<details") == text.count("<fieldset") - 1
    assert "(0-1)" not in text
    assert "{}" not in text
    values = dict(re.findall(r'<input[^>]*name="(\w+)"[^>]*value="([^"]*)"', text))
    chosen = re.findall(r'<option value="(\w+)" selected>', text)
    assert values["charge_limit"] == "20.0"
    assert "slow" in chosen
    form = {"title": "Lab robot", "name": "lab", "adapter": "ros2", "profile": "giraff"}
    unfolded = {"assist": "slow", "access": "open", "calls": "accept", "charge_limit": "20"}
    assert client.post(ADD, form | unfolded).status_code == 302
    robot = Robot.objects.get()
    assert (robot.adapter, robot.profile) == ("ros2", "giraff")
    assert (robot.enabled, robot.shown_to_visitors) == (True, False)
    assert (robot.assist, robot.charge_limit) == ("slow", 0.2)


def test_minimum_charge_is_in_percent(client, researcher, giraff):
    form = FORM | {"name": "giraff"}
    for wrong in ("101", "-1"):
        assert "errorlist" in posted(client, change_page(giraff), form | {"charge_limit": wrong})
    assert client.post(change_page(giraff), form | {"charge_limit": "35"}).status_code == 302
    assert Robot.objects.get().charge_limit == 0.35
    assert 'value="35.0"' in page(client, change_page(giraff))


def shown_credentials(text):
    file = re.search(r'<pre id="credentials-file">(.*?)</pre>', text, re.DOTALL)[1]
    return tomllib.loads(unescape(file))


def test_credentials_are_created_by_post_and_shown_once(client, researcher, giraff):
    address = f"{LIST}{giraff.pk}/credentials/"
    update_robots(adapter="ros1", profile="giraff", options={"ip": "10.0.0.3"})
    asked = page(client, address)
    giraff.refresh_from_db()
    assert not giraff.credentials.credential_hash  # a GET creates nothing
    assert_clean(asked)

    response = client.post(address, HTTP_HOST="localhost:8000")
    text = response.content.decode()
    assert_clean(text)
    assert "no-store" in response["Cache-Control"]
    credentials = shown_credentials(text)
    assert credentials["robot"] == "giraff"
    assert credentials["server"] == "http://localhost:8000"
    assert (credentials["adapter"], credentials["profile"]) == ("ros1", "giraff")
    assert credentials["options"] == {"ip": "10.0.0.3"}
    assert robot_of("giraff", credentials["token"]) == giraff
    command = unescape(re.search(r'<pre id="command">(.*?)</pre>', text, re.DOTALL)[1])
    assert (
        command == "telepresence run_robot giraff --server http://localhost:8000"
        " --credentials giraff.toml --adapter ros1 --profile giraff --option ip=10.0.0.3"
    )
    download = re.search(r'href="data:application/toml,([^"]*)" download="giraff\.toml"', text)[1]
    assert tomllib.loads(unquote(unescape(download))) == credentials

    assert credentials["token"] not in page(client, address)
    assert credentials["token"] not in page(client, change_page(giraff))
    assert credentials["token"] not in LogEntry.objects.get().change_message


def test_installed_adapters_are_offered_and_others_are_accepted(
    client, researcher, giraff, tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(str(tmp_path))
    install(tmp_path, "stranger-robots", "stranger")
    address = change_page(giraff)
    text = page(client, address)
    for name in ("simulator", "ros2", "stranger"):
        assert f'<option value="{name}">' in text
    assert_clean(text)

    giraff.adapter = "stranger"
    giraff.save()
    assert "Not installed on this server" not in page(client, address)
    giraff.adapter = "acme"
    giraff.full_clean()
    giraff.save()
    assert "Not installed on this server, which is fine" in page(client, address)

    made = posted(client, f"{LIST}{giraff.pk}/credentials/", HTTP_HOST="localhost:8000")
    assert shown_credentials(made)["adapter"] == "acme"
    assert "Choose them on its page" in made
    kind = {"adapter": "other", "adapter_other": "acme", "profile": "giraff"}
    enrolled = posted(client, f"{LIST}{giraff.pk}/enrol/", kind, HTTP_HOST="localhost:8000")
    assert "--adapter acme" in enrolled


@pytest.mark.parametrize("name", ["two words", "x; rm", "acme'", "--yes", "acme\n"])
def test_adapter_name_with_shell_characters_is_refused(giraff, name):
    giraff.adapter = name
    with pytest.raises(ValidationError, match="Enter a name or the path"):
        giraff.full_clean()


def test_only_users_who_may_change_robots_create_credentials(client, giraff):
    viewer = person("viewer", is_staff=True)
    viewer.user_permissions.add(Permission.objects.get(codename="view_robot"))
    client.force_login(viewer)
    address = f"{LIST}{giraff.pk}/credentials/"
    assert client.get(address).status_code == 403
    assert client.post(address).status_code == 403
    assert "new_credentials" not in page(client, LIST)
    client.logout()
    assert client.post(address).status_code == 302
    giraff.refresh_from_db()
    assert not giraff.credentials.credential_hash


def act(client, action, *robots):
    chosen = [str(robot.pk) for robot in robots]
    return posted(client, LIST, {"action": action, "_selected_action": chosen}, follow=True)


def test_action_opens_the_credentials_of_one_robot(client, researcher, giraff):
    assert "Create new credentials for" in act(client, "new_credentials", giraff)
    other = Robot.objects.create(name="rhodon", title="Rhodon")
    assert "Choose a single robot" in act(client, "new_credentials", giraff, other)


def test_credentials_are_revoked(client, researcher, giraff):
    client.post(f"{LIST}{giraff.pk}/credentials/")
    assert "1 robot can no longer connect." in act(client, "revoke_credentials", giraff)
    giraff.refresh_from_db()
    assert giraff.credentials.credential_hash == ""
    assert "none: the robot can't connect" in unescape(page(client, change_page(giraff)))


def test_robots_are_disabled_and_enabled(client, researcher, giraff):
    act(client, "disable", giraff)
    giraff.refresh_from_db()
    assert not giraff.enabled
    act(client, "enable", giraff)
    giraff.refresh_from_db()
    assert giraff.enabled


def test_permit_is_given_on_the_robots_page(client, researcher, giraff):
    visitor = person("ada")
    permit = {"user": str(visitor.pk), "kind": "trained", "robot": str(giraff.pk)}
    form = FORM | {f"permits-0-{name}": value for name, value in permit.items()}
    form |= {"access": "trained", "permits-TOTAL_FORMS": 1}
    assert client.post(change_page(giraff), form).status_code == 302
    assert RobotPermit.objects.get().user == visitor


# --- floor plans ----------------------------------------------------------------------------------


def files(*, plan=True, **replaced):
    content = {"map_file": "map.yaml", "image_file": "map.png", "plan_file": "plan.json"}
    return {
        field: SimpleUploadedFile(name, replaced.get(field, (OFFICE / name).read_bytes()))
        for field, name in content.items()
        if plan or field != "plan_file"
    }


def test_floor_plan_is_created_from_three_files(client, researcher):
    assert client.post(ADD_PLAN, files()).status_code == 302
    plan = FloorPlan.objects.get()
    assert plan.name == "office"
    text = page(client, f"/admin/robots/floorplan/{plan.pk}/change/")
    assert f"/floorplans/office.png?v={plan.sha256[:16]}" in text
    assert "2 doors" in text
    assert_clean(text)
    assert_clean(page(client, "/admin/robots/floorplan/"))
    assert_clean(page(client, ADD_PLAN))


def test_technical_details_of_a_floor_plan_are_folded_and_not_for_owners(client, researcher):
    client.post(ADD_PLAN, files())
    plan = FloorPlan.objects.get()
    address = f"/admin/robots/floorplan/{plan.pk}/change/"
    details = re.findall(r"<details>.*?</details>", page(client, address), re.DOTALL)
    assert "field-sha256" in details[-1]
    owner = person("owner", is_staff=True)
    create_robot(owner=owner, floor_plan=plan)
    client.force_login(owner)
    text = page(client, address)
    assert "2 doors" in text
    assert plan.sha256 not in text
    assert "origin" not in text.lower()


def test_map_without_a_plan_is_named_in_the_form(client, researcher):
    assert "needs a map id and a title" in posted(client, ADD_PLAN, files(plan=False))
    assert client.post(ADD_PLAN, files(plan=False) | LAB).status_code == 302
    assert FloorPlan.objects.get().title == "The lab"


@pytest.mark.parametrize(
    ("replaced", "word"),
    [
        ({"map_file": b"resolution: ["}, "map.yaml"),
        ({"image_file": b"GIF89a"}, "neither PNG nor PGM"),
        ({"plan_file": b" " * (MAX_PLAN + 1)}, "larger than"),
        ({"map_file": b""}, "empty"),
        ({"plan_file": b"[" * 200_000}, "plan.json"),
    ],
    ids=["map", "image", "large plan", "empty map", "nested plan"],
)
def test_unusable_files_are_refused_with_the_reason(client, researcher, replaced, word):
    assert word in posted(client, ADD_PLAN, files(**replaced))
    assert not FloorPlan.objects.exists()


def test_map_that_takes_too_long_is_refused(client, researcher, monkeypatch):
    quick = functools.partial(ChildLimits, elapsed=0.01)
    monkeypatch.setattr(limited_process, "ChildLimits", quick)
    assert "The file needs too much memory or time" in posted(client, ADD_PLAN, files())
    assert not FloorPlan.objects.exists()


def test_floor_plan_without_files_is_refused(client, researcher):
    assert "Choose the map" in posted(client, ADD_PLAN, LAB)


def test_second_upload_of_a_map_is_refused(client, researcher):
    store_floor_plan(OFFICE)
    assert "already exists" in posted(client, ADD_PLAN, files())


def test_floor_plan_is_renamed_and_its_files_are_replaced(client, researcher):
    plan = store_floor_plan(OFFICE)
    address = f"/admin/robots/floorplan/{plan.pk}/change/"
    assert client.post(address, {"title": "Our office"}).status_code == 302
    assert FloorPlan.objects.get().title == "Our office"
    assert client.post(address, {"title": ""}).status_code == 200
    yaml = YAML.replace(b"occupied_thresh: 0.65", b"occupied_thresh: 0.7")
    assert client.post(address, files(map_file=yaml) | {"title": "Our office"}).status_code == 302
    plan.refresh_from_db()
    assert (plan.occupied_thresh, plan.title, plan.name) == (0.7, "Our office", "office")
    wrong = files(map_file=YAML.replace(b"0.05", b"0.10")) | {"title": "Our office"}
    assert "do not show the same place" in posted(client, address, wrong)


def test_plan_of_another_map_is_refused(client, researcher):
    client.post(ADD_PLAN, files(plan=False) | LAB)
    address = f"/admin/robots/floorplan/{FloorPlan.objects.get().pk}/change/"
    assert "belongs to the map “office”" in posted(client, address, files() | {"title": "The lab"})


def put_doors(*doors):
    plan = floor_plan("flat", plan={"doors": doors})
    update_robots(floor_plan=plan, factsheet={"capabilities": ["doors"]})


def test_doors_are_opened_and_closed_on_their_page(client, researcher, giraff):
    put_doors({"name": "lab-door", "title": "Laboratory door"})
    address = f"{LIST}{giraff.pk}/doors/"
    assert "Laboratory door" in client.get(address).content.decode()
    text = posted(client, address, {"door": "lab-door", "state": "closed"}, follow=True)
    assert "Laboratory door is set to closed." in text
    assert Robot.objects.get(pk=giraff.pk).doors == {"lab-door": "closed"}
    for door, state in (("no-door", "closed"), ("lab-door", "ajar")):
        refused = posted(client, address, {"door": door, "state": state}, follow=True)
        assert "This door doesn't exist." in refused
    assert Robot.objects.get(pk=giraff.pk).doors == {"lab-door": "closed"}


def test_robot_that_is_paused_between_sessions_is_freed(client, researcher, giraff):
    RobotPresence.objects.update(turnaround="paused", turnaround_reason="estop")
    assert "Not ready: its emergency stop is on" in page(client, change_page(giraff))
    act(client, "free", giraff)
    assert Robot.objects.get(pk=giraff.pk).presence.turnaround == "ready"


def test_saving_a_robot_keeps_concurrent_changes(client, researcher, giraff, monkeypatch):
    form = client.get(change_page(giraff)).context["adminform"].form
    sent = {name: form[name].value() or "" for name in form.fields}
    sent |= {"permits-TOTAL_FORMS": 0, "permits-INITIAL_FORMS": 0, "title": "Renamed"}
    clean = RobotForm.clean

    def slowly(self):
        update_robots(connection="CONNECTIONBROKEN", turnaround="paused", credential_hash="new")
        update_robots(held="repair", doors={"lab": "open"}, max_linear=0.3)
        return clean(self)

    monkeypatch.setattr(RobotForm, "clean", slowly)
    assert client.post(change_page(giraff), sent).status_code == 302
    saved = Robot.objects.get()
    assert (saved.title, saved.held) == ("Renamed", "repair")
    assert (saved.doors, saved.max_linear) == ({"lab": "open"}, 0.3)
    assert (saved.presence.connection, saved.presence.turnaround) == ("CONNECTIONBROKEN", "paused")
    assert saved.credentials.credential_hash == "new"


def test_concurrent_changes_of_two_doors_are_both_kept(client, researcher, giraff, monkeypatch):
    put_doors({"name": "lab"}, {"name": "hall"})
    read = RobotAdmin.managed

    def slowly(self, *args):
        robot = read(self, *args)
        Robot.objects.update(doors={"hall": "closed"})
        return robot

    monkeypatch.setattr(RobotAdmin, "managed", slowly)
    client.post(f"{LIST}{giraff.pk}/doors/", {"door": "lab", "state": "closed"})
    assert Robot.objects.get().doors == {"hall": "closed", "lab": "closed"}
