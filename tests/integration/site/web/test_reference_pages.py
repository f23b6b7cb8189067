"""The reference of file formats as pages of the site: all of it, in HTML, and nothing else."""

import re

import pytest
from django.urls import reverse

from telepresence_site.web.reference_pages import FOLDER, PAGES
from tests.support.browsers.html_page import faults, read

pytestmark = pytest.mark.django_db


@pytest.mark.parametrize("name", PAGES)
def test_reference_page_has_every_heading_table_and_line_of_code(client, name):
    source = (FOLDER / f"{name}.md").read_text()
    answer = client.get(reverse("reference", args=[name]))
    page = read(answer)
    assert faults(page) == []
    headings = [found.strip() for found in re.findall(r"^#+ (.*)$", source, re.MULTILINE)]
    shown = [e.text for e in page.elements if re.fullmatch("h[1-4]", e.tag)]
    assert shown == headings
    rows = re.findall(r"^\|(?! ---)", source, re.MULTILINE)
    assert len(page.all("tr")) == len(rows)
    assert len(page.all("pre")) == source.count("```") / 2
    text = re.sub(r"<pre>.*?</pre>|<code>.*?</code>", "", answer.content.decode(), flags=re.DOTALL)
    assert not re.search(r"`|\]\(|\| ---|^#", text, re.MULTILINE)


def test_unknown_page_of_the_reference_is_not_found(client):
    for name in ("nothing", "settings", "robot-api"):
        assert client.get(f"/reference/{name}/").status_code == 404
    assert client.get("/reference/..%2F..%2FREADME/").status_code == 404
