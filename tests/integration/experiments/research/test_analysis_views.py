"""The analysis page: members see the current data, with the sessions behind
everything that it shows.
"""

import io
import re
import time
import zipfile

import numpy as np
import pytest
from django.test import AsyncClient
from django.urls import reverse

from accounts.models import AuditEntry
from experiments import versions
from experiments.analysis.page import write_page
from experiments.analysis.report import analyse
from experiments.extraction.build import dataset_of
from experiments.extraction.pseudonyms import Pseudonyms
from experiments.models import Drive, Participant, StudyMember
from experiments.research import analysis_cache
from experiments.research.analysis_topics import TOPICS, topic_of
from robots.models import FloorPlan, Robot, RobotPresence
from sessions.models import SystemLog
from tests.support.analysis.study_dataset import made_up
from tests.support.browsers.html_page import read
from tests.support.people import person
from tests.support.sessions.replays import PLAN
from tests.support.studies.study_rows import put

pytestmark = pytest.mark.django_db
PAGE = "/studies/exploration/analysis/"
EXPORT = "/studies/exploration/export/"


def computed(study, kinds=("participant",)):
    """The report on a study, made here: a process of its own does not see what a test has not
    committed.
    """
    key = analysis_cache.key_of(study, kinds)
    folder = analysis_cache.home(study) / key
    analyse(dataset_of(study), folder, kinds, write_page)
    return analysis_cache.Stored(key, folder)


@pytest.fixture
def stored(settings, tmp_path, monkeypatch):
    """A study; its figures are not drawn as PDF, which takes most of the time and no page shows."""
    settings.VAR_DIR = tmp_path
    monkeypatch.setattr("experiments.analysis.report.as_pdf", lambda _: b"%PDF-1.7")
    return put(made_up(np.random.default_rng(91), 4))


@pytest.fixture
def member(stored, client):
    """A viewer of the study, signed in."""
    user = person("vera")
    StudyMember.objects.create(slug=stored.study.slug, user=user, role="viewer")
    client.force_login(user)
    return user


def pages(client, **query) -> dict[str, str]:
    """The page of each topic by its key."""
    return {
        topic.key: client.get(
            PAGE if topic is TOPICS[0] else f"{PAGE}{topic.key}/", query
        ).content.decode()
        for topic in TOPICS
    }


@pytest.mark.parametrize(
    "address",
    ["", "outcomes/", "tables/table-5/", "sessions/0/", "files/tables/table-5.csv", "dataset.zip"],
)
def test_the_analysis_is_absent_for_all_but_members(stored, client, address):
    assert client.get(PAGE + address).status_code == 404
    assert client.get(EXPORT).status_code == 404
    client.force_login(person("somebody", is_staff=True))
    assert client.get(PAGE + address).status_code == 404
    assert client.get(EXPORT).status_code == 404


@pytest.mark.nightly
def test_every_table_and_figure_is_on_the_page_of_one_topic_unless_it_is_empty(
    stored, member, client
):
    report = computed(stored.study)
    shown = pages(client)
    summary = report.read("counting", "summary")
    for one in (*summary["tables"], *summary["figures"]):
        where = [key for key, html in shown.items() if f'id="{one["name"]}"' in html]
        assert where == ([] if one["empty"] else [topic_of(one["name"]).key]), one["name"]
    for html in shown.values():
        assert "Computed on" in html
        assert "not the study" not in html
        assert not re.search(r"<svg[^>]*>.*?style=", html, re.DOTALL)
    assert sum(html.count("<svg") for html in shown.values()) >= 4
    assert client.get(f"{PAGE}nothing/").status_code == 404


def test_a_topic_is_marked_and_those_with_nothing_to_show_are_not_offered(stored, member, client):
    Drive.objects.all().delete()
    computed(stored.study)
    page = read(client.get(PAGE))
    offered = [e for e in page.all("a") if e.attributes["href"].startswith(PAGE)]
    assert [e.text.strip() for e in offered if e.attributes.get("aria-current")] == [
        "Analysis",
        "Overview",
    ]
    assert "Network" not in [e.text.strip() for e in offered]
    assert "nothing to show on this topic yet" in pages(client)["network"]


@pytest.mark.nightly
def test_conditions_are_called_by_their_titles(stored, member, client):
    report = computed(stored.study)
    titles = {
        one.key: one.title["en"]
        for one in stored.study.as_definition().conditions
        if one.title["en"] != one.key
    }
    assert titles
    shown = "".join(pages(client).values())
    numbers = {int(n) for n in re.findall(r"/analysis/sessions/(\d+)/", shown)}
    for html in (shown, client.get(f"{PAGE}sessions/{min(numbers)}/").content.decode()):
        words = re.sub(r"<svg.*?</svg>|<[^>]*>", " ", html, flags=re.DOTALL)
        assert not [key for key in titles if re.search(rf"\b{key}\b", words)]
    csv = (report.folder / "counting" / "tables" / "sessions.csv").read_text()
    assert any(key in csv for key in titles)


def test_the_dataset_is_offered_on_a_page_of_its_own(stored, member, client):
    page = read(client.get(EXPORT))
    (form,) = (e for e in page.all("form") if e.attributes.get("action", "").endswith(".zip"))
    assert form.attributes["method"] == "get"
    names = [e.attributes.get("name") for e in page.all("input")]
    assert "free_text" not in names
    assert "identified" not in names
    StudyMember.objects.filter(user=member).update(role="owner")
    names = [e.attributes.get("name") for e in read(client.get(EXPORT)).all("input")]
    assert {"free_text", "identified", "snapshots"} <= set(names)


def test_each_number_and_part_of_a_figure_links_to_sessions_and_their_replays(
    stored, member, client
):
    computed(stored.study)
    html = "".join(pages(client).values())
    links = sorted(
        set(re.findall(r'href="(/studies/exploration/analysis/sessions/\d+/[^"]*)"', html))
    )
    assert len(links) > 20
    drawn = html[html.index('id="figure-7"') : html.index("</svg>", html.index('id="figure-7"'))]
    assert drawn.count("/analysis/sessions/") == drawn.count('id="figure-7-session-')
    keys = {
        Pseudonyms(stored.study.secret).session(drive.session_id): str(drive.session_id)
        for drive in stored.drives.values()
    }
    for link in links[:6]:
        shown = client.get(link.replace("&amp;", "&"))
        assert shown.status_code == 200
        codes = re.findall(r'<th scope="row">(\w+)</th>', shown.content.decode())
        assert codes
        assert all(
            reverse("replay", args=[keys[code]]) + "?t=" in shown.content.decode() for code in codes
        )


def test_the_mean_in_table_5_leads_to_the_sessions_whose_answers_count(stored, member, client):
    report = computed(stored.study)
    (row,) = (row for row in report.read("counting", "table-table-5") if row[0][0] == "Overall")
    number = row[-4][1]
    expected = report.read("counting", "sets")[number]
    assert len(expected) == len({one.participant_id for one in stored.drives.values()})
    shown = client.get(f"{PAGE}sessions/{number}/?report={report.key}").content.decode()
    assert set(re.findall(r'<th scope="row">(\w+)</th>', shown)) == set(expected)


def test_pilots_and_bots_are_clearly_marked(stored, member, client):
    Participant.objects.filter(code="P000").update(kind="bot")
    computed(stored.study, ("bot",))
    html = client.get(PAGE, {"kind": "bot"}).content.decode()
    assert (
        "These are not the study&#x27;s results" in html
        or "These are not the study's results" in html
    )
    assert 'class="tag analysis__kind">bot' in html


@pytest.mark.nightly
def test_excluded_sessions_can_be_left_out(stored, member, client):
    drive = next(iter(stored.drives.values()))
    Drive.objects.filter(pk=drive.pk).update(excluded_reason="a test drive")
    computed(stored.study)
    assert "Sensitivity: with excluded drives" in client.get(PAGE).content.decode()
    every, without = (
        client.get(f"{PAGE}trajectories/", query).content.decode()
        for query in ({"selection": "all"}, {})
    )
    code = Pseudonyms(stored.study.secret).session(drive.session_id)
    assert f"figure-7-session-{code}" in every
    assert f"figure-7-session-{code}" not in without


def test_a_change_of_the_data_changes_the_key_of_the_report(stored):
    before = analysis_cache.key_of(stored.study, ("participant",))
    assert before == analysis_cache.key_of(stored.study, ("participant",))
    assert before != analysis_cache.key_of(stored.study, ("bot",))
    for change in (
        lambda: Robot.objects.filter(name="giraff").update(title="Another Giraff"),
        lambda: RobotPresence.objects.update(factsheet={"series": "giraff", "rca": "ROS"}),
        lambda: FloorPlan.objects.filter(name="office").update(plan=PLAN),
    ):
        change()
        known, before = before, analysis_cache.key_of(stored.study, ("participant",))
        assert before != known
    Drive.objects.filter(pk=next(iter(stored.drives.values())).pk).update(
        excluded_reason="a test drive"
    )
    assert before != analysis_cache.key_of(stored.study, ("participant",))


def test_a_new_release_or_library_changes_the_key_of_the_report(stored, monkeypatch, request):
    request.addfinalizer(versions.analysis_versions.cache_clear)
    before = analysis_cache.key_of(stored.study, ("participant",))
    monkeypatch.setattr(versions, "software_version", lambda: "9.9.9")
    versions.analysis_versions.cache_clear()
    release = analysis_cache.key_of(stored.study, ("participant",))
    monkeypatch.setattr(versions.metadata, "version", lambda _name: "99.0")
    versions.analysis_versions.cache_clear()
    library = analysis_cache.key_of(stored.study, ("participant",))
    assert len({before, release, library}) == 3


def test_files_are_those_of_the_report_and_nothing_else_can_be_fetched(stored, member, client):
    report = computed(stored.study)
    for kind, name in (
        ("tables", "table-5.csv"),
        ("tables", "table-5.tex"),
        ("figures", "figure-8a.pdf"),
        ("figures", "figure-7.svg"),
    ):
        answer = client.get(f"{PAGE}files/{kind}/{name}", {"report": report.key})
        written = (report.folder / "counting" / kind / name).read_bytes()
        assert b"".join(answer.streaming_content) == written
        entry = AuditEntry.objects.get(act="analysis_exported", detail=name)
        assert (entry.study, entry.thing) == (stored.study.slug, "version 1")
    for wrong in (
        "files/page/sets.json",
        "files/tables/nothing.csv",
        "files/tables/..%2F..%2F..%2Fsettings.csv",
        "files/figures/sources.json",
    ):
        assert client.get(PAGE + wrong, {"report": report.key}).status_code == 404
    assert client.get(f"{PAGE}files/tables/table-5.csv", {"report": "../../etc"}).status_code == 404


@pytest.mark.nightly
def test_a_long_table_comes_some_rows_at_a_time(stored, member, client, monkeypatch):
    monkeypatch.setattr("experiments.research.analysis_views.ROWS_A_PAGE", 3)
    monkeypatch.setattr("experiments.research.analysis_views.SHORT", 3)
    report = computed(stored.study)
    assert "Open the table" in client.get(f"{PAGE}data-quality/").content.decode()
    first = client.get(f"{PAGE}tables/sessions/").content.decode()
    assert first.count("<tr>") == 1 + 3
    assert "Page 1 of" in first
    assert client.get(f"{PAGE}tables/sessions/?page=2").content.decode() != first
    assert client.get(f"{PAGE}tables/nothing/").status_code == 404
    assert client.get(f"{PAGE}sessions/{len(report.read('counting', 'sets'))}/").status_code == 404


@pytest.mark.parametrize("query", ["version=7", "version=x", "version=99999999999"])
def test_an_unknown_version_is_not_found(stored, member, client, query):
    assert client.get(f"{PAGE}?{query}").status_code == 404


def test_page_states_that_a_study_has_no_drives(member, client, stored):
    Drive.objects.all().delete()
    Participant.objects.all().delete()
    computed(stored.study)
    assert "No drives yet" in client.get(PAGE).content.decode()


def test_one_version_has_an_address_of_its_own(stored, member, client):
    assert client.get(reverse("study_analysis", args=[stored.study.pk])).url == f"{PAGE}?version=1"


def test_a_viewer_cannot_export_free_text_photos_or_names(stored, member, client):
    for chosen in ("free_text", "snapshots", "identified"):
        assert client.get(f"{PAGE}dataset.zip", {chosen: "1"}).status_code == 404
    StudyMember.objects.filter(user=member).update(role="researcher")
    assert client.get(f"{PAGE}dataset.zip", {"identified": "1"}).status_code == 404
    assert not SystemLog.objects.filter(event="study_exported").exists()


def computing(monkeypatch, script: str) -> None:
    """Have a shell script in place of the process that computes a report."""
    monkeypatch.setattr(analysis_cache, "command", lambda *_: ["sh", "-c", script])


def refreshed(client, answer) -> str:
    """Follow a page that is not ready until it is, as a browser does; return its last address."""
    while answer.status_code == 202:
        seconds, _, address = answer["Refresh"].partition("; url=")
        time.sleep(float(seconds) / 4)
        answer = client.get(address)
    return answer


@pytest.mark.nightly
@pytest.mark.django_db(transaction=True)
def test_report_is_computed_once_by_another_process_while_the_page_shows_progress(
    stored, member, client
):
    begin = time.monotonic()
    answer = client.get(f"{PAGE}questionnaires/")
    assert answer.status_code == 202
    assert time.monotonic() - begin < 1.0
    done = refreshed(client, answer)
    assert 'id="figure-8b"' in done.content.decode()
    (folder,) = analysis_cache.home(stored.study).iterdir()
    made = (folder / "SHA256SUMS").stat().st_mtime_ns
    assert client.get(PAGE).status_code == 200
    assert (folder / "SHA256SUMS").stat().st_mtime_ns == made


@pytest.mark.parametrize(
    ("printed", "said"),
    [
        ("", "Starting"),
        (
            '{"measured":0,"sessions":8,"files":0,"seconds":1.2}',
            "answers and events · 1 s",
        ),
        ('{"measured":3,"sessions":8,"files":0,"seconds":5.2}', "Measuring drives: 3 of 8 · 5 s"),
        ('{"measured":8,"sessions":8,"files":70,"seconds":9}', "figures: 70 files so far · 9 s"),
    ],
)
def test_progress_page_names_the_current_computation(
    stored, member, client, monkeypatch, tmp_path, printed, said
):
    go = tmp_path / "go"
    computing(monkeypatch, f"echo '{printed}'; until [ -e {go} ]; do sleep 0.1; done")
    client.get(PAGE)
    (log,) = analysis_cache.home(stored.study).glob("*.log")
    process = analysis_cache._started[log]
    deadline = time.monotonic() + 10.0
    while printed not in log.read_text() and time.monotonic() < deadline:
        time.sleep(0.02)
    answer = client.get(PAGE)
    assert analysis_cache._started[log] is process, "one process computes a report"
    go.touch()
    process.wait()
    assert answer.status_code == 202
    assert said in " ".join(read(answer).text.split())


def test_page_keeps_its_report_while_the_data_change(stored, member, client):
    report = computed(stored.study)
    Drive.objects.filter(pk=next(iter(stored.drives.values())).pk).update(outcome="cancelled")
    page = read(client.get(f"{PAGE}outcomes/", {"report": report.key}))
    assert "The data have changed since then." in page.text
    topics = [e.attributes["href"] for e in page.all("a") if f"{PAGE}quest" in e.attributes["href"]]
    assert f"report={report.key}" in topics[0]
    again = [e.attributes["href"] for e in page.all("a") if e.text == "Compute again"]
    assert "report=" not in again[0]


def test_a_failed_computation_shows_its_reason_and_can_be_repeated(
    stored, member, client, monkeypatch
):
    progress = '{"measured":0,"sessions":8,"files":0,"seconds":1.2}'
    computing(monkeypatch, f"echo the disk is full >&2; echo '{progress}'; exit 3")
    assert client.get(PAGE).status_code == 202
    for process in analysis_cache._started.values():
        process.wait()
    answer = client.get(PAGE)
    assert answer.status_code == 503
    assert "the disk is full" in answer.content.decode()
    assert list(analysis_cache.home(stored.study).glob("*.log")) == []
    assert client.get(PAGE).status_code == 202


def test_computation_of_a_process_that_is_gone_is_reported_as_interrupted(
    stored, member, client, monkeypatch
):
    log = analysis_cache.home(stored.study) / (
        f"{analysis_cache.key_of(stored.study, ('participant',))}.log"
    )
    log.parent.mkdir(parents=True)
    log.write_text('{"measured":0,"sessions":8,"files":0,"seconds":1.2}\n')
    assert client.get(PAGE).status_code == 202
    monkeypatch.setattr(analysis_cache, "STALE_SECONDS", -1.0)
    assert "The computation was interrupted." in client.get(PAGE).content.decode()


@pytest.mark.nightly
@pytest.mark.django_db(transaction=True)
async def test_public_dataset_has_nothing_of_what_else_was_chosen(stored, member):
    client = AsyncClient()
    await client.aforce_login(member)
    answer = await client.get(f"{PAGE}dataset.zip", {"public": "1", "mcap": "1"})
    content = b"".join([part async for part in answer.streaming_content])
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert "## Anonymity" in archive.read("README.md").decode()
        assert not [name for name in archive.namelist() if name.startswith("mcap/")]
    log = await SystemLog.objects.aget(event="study_exported")
    assert log.fields["chosen"] == ["public"]


@pytest.mark.nightly
@pytest.mark.django_db(transaction=True)
async def test_the_dataset_is_sent_as_it_is_made_and_it_is_written_down_who_took_it(stored, member):
    client = AsyncClient()
    await client.aforce_login(member)
    answer = await client.get(f"{PAGE}dataset.zip")
    content = b"".join([part async for part in answer.streaming_content])
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        assert {"study.json", "SHA256SUMS", "data/description-metrics_data.csv"} <= set(
            archive.namelist()
        )
    log = await SystemLog.objects.aget(event="study_exported")
    assert (log.fields["user"], log.fields["chosen"]) == (str(member.pk), [])


def test_a_page_has_headings_without_full_stops_and_marks_their_language(stored, member, client):
    computed(stored.study)
    client.cookies["django_language"] = "es"
    page = read(client.get(PAGE))
    headings = [one.text.strip() for one in page.all("h2")]
    assert headings
    assert not [one for one in headings if one.endswith(".")]
    parts = [one for one in page.all("section") if "analysis__part" in one.attributes["class"]]
    assert {one.attributes["lang"] for one in parts} == {"en"}
    assert "Las tablas y figuras están en inglés" in page.text
    assert "participantes" in page.text
    client.cookies["django_language"] = "en"
    assert "are in English" not in read(client.get(PAGE)).text
