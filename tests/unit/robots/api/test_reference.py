import pytest

from robots.api import messages, topics
from robots.api.reference import classes, generated_files, reference
from tests.support.paths import ROOT


@pytest.mark.parametrize("name", sorted(generated_files()))
def test_what_is_generated_stands_in_the_tree_as_it_is_generated(name):
    assert (ROOT / name).read_text(encoding="utf-8") == generated_files()[name], (
        "run python -m robots.api.reference"
    )


@pytest.mark.parametrize(
    "topic", [*topics.TABLE, *topics.DATA_CHANNEL_ONLY], ids=lambda topic: topic.suffix
)
def test_every_topic_stands_in_the_reference_with_its_messages_and_an_example(topic):
    section = reference().partition(f"### `{topic.suffix}`\n")[2].partition("\n### ")[0]
    assert topic.doc[1:] in section
    for kind in classes(topic.content):
        assert f"#### {kind.__name__}\n" in section
    assert topic.content is bytes or "```json" in section


def test_every_link_to_a_part_has_its_heading():
    text = reference()
    for name in [
        kind.__name__
        for kind in vars(messages).values()
        if isinstance(kind, type) and f"](#{kind.__name__.lower()})" in text
    ]:
        assert f"# {name}\n" in text
