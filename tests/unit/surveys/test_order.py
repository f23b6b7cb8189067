"""Orders: as written, or shuffled by a recorded seed."""

from surveys.item import Viewing
from tests.support.studies.questionnaires import NOW, OPTIONS, defined, item, rows

NONE = {"value": "none", "label": {"en": "None"}, "alone": True}


def keys(definition, seed):
    return [question.key for question in definition.questions_shown(seed)]


def shuffled_page(*names: str):
    page = {"key": "p", "order": "shuffled", "items": [item("single", name) for name in names]}
    return defined(pages=[page])


def test_a_fixed_order_is_the_written_one_whatever_the_seed():
    definition = defined(
        [item("single", "a"), item("grid", "g", rows=rows("r1", "r2"))], [item("single", "z")]
    )
    assert {tuple(keys(definition, seed)) for seed in range(20)} == {("a", "r1", "r2", "z")}


def test_a_seed_gives_the_same_order_again_and_other_seeds_give_others():
    definition = shuffled_page(*"abcdef")
    assert keys(definition, 7) == keys(definition, 7)
    orders = {tuple(keys(definition, seed)) for seed in range(200)}
    assert len(orders) > 100
    assert all(sorted(order) == list("abcdef") for order in orders)


def test_an_order_does_not_depend_on_the_version_of_python_that_draws_it():
    assert keys(shuffled_page(*"abcdef"), 1) == list("ebcfad")


def test_every_item_comes_first_about_equally_often():
    page = shuffled_page(*"abc")
    firsts = [keys(page, seed)[0] for seed in range(3000)]
    assert all(900 < firsts.count(name) < 1100 for name in "abc")


def test_an_option_that_excludes_the_others_stays_at_the_end():
    definition = defined([item("multiple", "m", order="shuffled", options=[NONE, *OPTIONS])])
    m = definition.question("m").item
    assert {m.options_shown(seed)[-1].value for seed in range(20)} == {"none"}
    assert len({m.options_shown(seed)[0].value for seed in range(50)}) == 6


def test_options_to_rank_stand_as_shuffled_and_once_ranked_in_their_order():
    question = defined([item("ranking", "r", order="shuffled", options=OPTIONS)]).question("r")

    def shown(chosen, seed):
        widget = question.item.widget(question, chosen, Viewing("en", seed, NOW))
        return "".join(choice.value for choice in widget.choices)

    assert len({shown([], seed) for seed in range(50)}) > 30
    ranked = question.item.sent(list("fbdace"))
    assert {shown(ranked, seed) for seed in range(20)} == {"fbdace"}
    assert shown(["2.d", "2.a", "1.e", "x.b"], 3)[:1] == "e"
    assert set(shown(["2.d", "2.a", "1.e", "x.b"], 3)[1:3]) == {"a", "d"}


def test_positions_count_questions_as_they_are_met():
    definition = defined(
        pages=[
            {
                "key": "p",
                "order": "shuffled",
                "items": [item("grid", "g", rows=rows("r1", "r2")), item("single", "s")],
            }
        ]
    )
    found = {tuple(sorted(definition.positions(seed).items())) for seed in range(50)}
    assert found == {(("r1", 1), ("r2", 2), ("s", 3)), (("r1", 2), ("r2", 3), ("s", 1))}
