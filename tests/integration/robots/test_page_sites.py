"""A robot's map becomes a site in the administration, in which a robot reaches goals all over the
floor and docks again.
"""

import numpy as np
import pytest
from django.contrib.auth import get_user_model

from benchmarks.driving.mapped_sites import spread_goals, tour
from robots.world.grid import write_grid
from robots.world.robot_models import GIRAFF
from robots.world.sites import load_site
from tests.support.agents.mapped_building import building, mapped
from tests.support.agents.page_sites import site_by_page

pytestmark = [pytest.mark.django_db, pytest.mark.long, pytest.mark.nightly]


def test_robot_drives_in_a_site_that_was_saved_as_proposed(client, settings, tmp_path):
    settings.VAR_DIR = tmp_path / "var"
    client.force_login(get_user_model().objects.create_superuser("owner"))
    write_grid(mapped(building(furnished=True), np.random.default_rng(1)), tmp_path)
    site = load_site(str(site_by_page(client, tmp_path / "map.yaml", "hall")))
    goals = spread_goals(site, GIRAFF, 1, 6)
    assert {site.plan.room_at(*goal).name for goal in goals} == {r.name for r in site.plan.rooms}
    drives = tour(site, GIRAFF, goals, 1)
    assert (drives.outcomes["reached"], drives.contacts) == (6, 0), drives.notes
    assert drives.docked
