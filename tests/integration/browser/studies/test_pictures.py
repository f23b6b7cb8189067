"""The analysis page shows what its picture in the README shows; `make pictures` takes it again."""

import pytest

from tests.support.browsers.pictures import analysis
from tests.support.browsers.shown import differences, records
from tests.support.sessions.site import running_site

pytestmark = [pytest.mark.browser, pytest.mark.nightly]


def test_analysis_page_shows_what_its_picture_shows(browser, tmp_path):
    with running_site(tmp_path) as site:
        vera, shown = analysis(browser, site)
        vera.close()
    assert differences(records()["pages"]["analysis"], shown) == [], "run `make pictures`"
