"""A pose on the whole map from one scan."""

from robots.agent.localization.field import field_of
from robots.agent.localization.global_search import GlobalSearch, Searching
from robots.agent.localization.sensor_model import SensorModel
from tests.support.agents.drawn_map import drawn_map


def test_a_map_with_little_free_space_has_places_for_a_search() -> None:
    picture = "###\n#.#\n###"
    whole = GlobalSearch(field_of(drawn_map(picture, scale=2)), SensorModel(), Searching())
    assert len(whole.places) > 0
