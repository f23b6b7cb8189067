"""A pose on the whole map from one scan."""

import math

import numpy as np
import pytest

from robots.agent.localization.field import field_of
from robots.agent.localization.global_search import Found, GlobalSearch, Searching
from robots.agent.localization.particle_filter import wrapped
from robots.agent.localization.sensor_model import SensorModel, Sweep, sweep_of
from robots.api.geometry import Pose2D
from tests.support.agents.drawn_map import beams_from, drawn_map, standing


def test_a_map_with_little_free_space_has_places_for_a_search() -> None:
    picture = "###\n#.#\n###"
    whole = GlobalSearch(field_of(drawn_map(picture, scale=2)), SensorModel(), Searching())
    assert len(whole.places) > 0
