import numpy as np
import pytest
from scipy import stats

from experiments.bots.endings import EVERY, Ending, draw, in_turn
from experiments.bots.persona import Effect, EffectError, Persona, effect
from tests.support.examples import binomial_band, repetitions

HELPED, ALONE = {"assist": "steer"}, {"assist": "off"}
SHARE = 0.05


def opinions(item, circumstances, *effects, bots=400):
    return np.array(
        [Persona(number, 7, effects).opinion(item, circumstances) for number in range(bots)]
    )


def test_persona_depends_on_seed_and_number_alone():
    first, again, other = Persona(3, 7), Persona(3, 7), Persona(4, 7)
    assert first.opinion("easy", ALONE) == again.opinion("easy", ALONE)
    assert first.opinion("easy", ALONE) != other.opinion("easy", ALONE)
    assert first.birth_year == again.birth_year


def test_an_opinion_has_the_mean_and_variance_that_effects_are_measured_in():
    found = opinions("easy", ALONE, bots=2000)
    assert abs(found.mean()) < 0.08
    assert found.std() == pytest.approx(1.0, abs=0.06)


def test_a_planted_effect_is_found_where_it_was_planted_and_nowhere_else():
    planted = Effect("easy", 0.8, HELPED)
    helped, alone = opinions("easy", HELPED, planted), opinions("easy", ALONE, planted)
    assert (helped.mean() - alone.mean()) == pytest.approx(0.8, abs=0.2)
    assert stats.ttest_rel(helped, alone).pvalue < 1e-6
    assert (
        stats.ttest_rel(opinions("fun", HELPED, planted), opinions("fun", ALONE, planted)).pvalue
        > 0.001
    )


@pytest.mark.slow
def test_a_planted_null_is_significant_as_often_as_chance_makes_it():
    null = Effect("easy", 0.0, HELPED)
    found, studies = 0, repetitions(120, thorough=400)
    for study in range(studies):
        helped = [Persona(number, study, [null]).opinion("easy", HELPED) for number in range(12)]
        alone = [
            Persona(100 + number, study, [null]).opinion("easy", ALONE) for number in range(12)
        ]
        found += stats.ttest_ind(helped, alone).pvalue < SHARE
    low, high = binomial_band(SHARE, studies)
    assert low <= found / studies <= high


def test_without_effects_every_point_of_a_scale_is_as_likely_as_any_other():
    points = [Persona(number, 7).point("easy", 5, ALONE) for number in range(2000)]
    assert stats.chisquare(np.bincount(points, minlength=5)).pvalue > 0.001


def test_bots_that_explore_choose_every_option_in_turn():
    assert [Persona(number, 7, explore=number).option("gender", 3) for number in range(4)] == [
        0,
        1,
        2,
        0,
    ]


def test_effect_is_parsed():
    assert effect("easy@assist=steer:0.8") == Effect("easy", 0.8, HELPED)
    assert effect("pace:-0.5") == Effect("pace", -0.5)
    both = {"assist": "steer", "drive": "2"}
    assert effect("easy@assist=steer,drive=2:.5") == Effect("easy", 0.5, both)


def test_an_effect_of_several_circumstances_needs_all_of_them():
    planted = Effect("easy", 0.8, {"assist": "steer", "interface": "novice"})
    both = {"assist": "steer", "interface": "novice"}
    for circumstances, shift in ((both, 0.8), (HELPED, 0.0), ({**both, "assist": "off"}, 0.0)):
        with_it = Persona(1, 7, [planted]).opinion("easy", circumstances)
        assert with_it - Persona(1, 7).opinion("easy", circumstances) == pytest.approx(shift)


def test_the_order_of_drives_changes_nothing_but_what_is_planted_on_it():
    first, second = ({**HELPED, "drive": number} for number in "12")
    better = [Effect("easy", 0.5, {"drive": "2"})]
    plain = Persona(1, 7).opinion("easy", HELPED)
    assert [Persona(1, 7).opinion("easy", one) for one in (first, second)] == [plain, plain]
    assert Persona(1, 7, better).opinion("easy", first) == plain
    assert Persona(1, 7, better).opinion("easy", second) == pytest.approx(plain + 0.5)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "easy",
        "easy:",
        "easy@assist:0.8",
        "easy@assist=steer",
        "easy@assist=steer,:1",
        "Easy:1",
        "easy:much",
    ],
)
def test_text_that_is_no_effect_is_refused_with_an_example(text):
    with pytest.raises(EffectError, match="such as"):
        effect(text)


def test_endings_are_drawn_by_seed_or_taken_in_turn():
    assert draw(50, np.random.default_rng(1)) == draw(50, np.random.default_rng(1))
    assert draw(200, np.random.default_rng(1)).count(Ending.COMPLETES) > 100
    assert set(in_turn(len(EVERY))) == set(EVERY)
