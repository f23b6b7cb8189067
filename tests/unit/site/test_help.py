"""The messages that the help for visitors and owners explains are those of the product."""

import re

import pytest

from tests.support.paths import ROOT
from tests.unit.site.test_pictures import product

PAGES = ("visitors", "owners")


def explained(page: str) -> list[str]:
    """Return the messages that a page of help quotes."""
    text = (ROOT / f"docs/help/{page}.md").read_text("utf-8")
    return re.findall(r"“([^”]+)”", text)


@pytest.mark.parametrize("page", PAGES)
def test_every_message_that_help_explains_is_in_the_product(page):
    assert len(explained(page)) > 5
    assert [message for message in explained(page) if message not in product()] == []


def test_message_that_no_page_shows_is_found():
    assert "The robot has lost its hat." not in product()
