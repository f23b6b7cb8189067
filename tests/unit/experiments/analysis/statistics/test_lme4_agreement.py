"""Mixed models agree with lme4 on 21 data sets that come with R (tests/support/analysis/lme4/), and
their tests with clubSandwich (CR2; Satterthwaite, HTZ).

Both maximize the same restricted likelihood, so the optima are the same, also in Dyestuff2
and CO2, whose groups do not differ beyond chance (the variance is 0).
"""

import csv
from itertools import product

import numpy as np
import pytest

from experiments.analysis.statistics.mixed_models import LEAST_DF, RobustTests, grouped, reml
from experiments.analysis.statistics.models import INTERCEPT, CannotFitError, Design, design_of
from tests.support.paths import ROOT

FOLDER = ROOT / "tests" / "support" / "analysis" / "lme4"
RELATIVE = 1e-4


def table(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


MODELS = {one["name"]: one for one in table(FOLDER / "models.csv")}


def columns_of(model, rows, key):
    """The columns of a factor or a number, by name."""
    if key in model["numbers"].split():
        return [(key, np.array([float(row[key]) for row in rows]))]
    levels = sorted({row[key] for row in rows})
    found = design_of({key: levels}, (key,), rows, model["coding"])
    return list(zip(found.names, found.columns.T, strict=True))[1:]


def design(model, rows):
    """The columns in R's order: of an interaction the first part changes first."""
    columns, names, places = [np.ones(len(rows))], [INTERCEPT], [0]
    for number, term in enumerate(model["terms"].split(), start=1):
        parts = [columns_of(model, rows, key) for key in term.split(":")]
        for combination in product(*reversed(parts)):
            columns.append(np.prod([column for _, column in combination], axis=0))
            names.append(":".join(name for name, _ in reversed(combination)))
            places.append(number)
    return Design(np.column_stack(columns), tuple(names), tuple(places))


def data_of(name):
    rows = table(FOLDER / "data" / f"{name}.csv")
    outcome = np.array([float(row["outcome"]) for row in rows])
    groups, people = grouped([row["who"] for row in rows])
    return outcome, design(MODELS[name], rows), groups, people


def test_there_are_twenty_one_data_sets():
    assert len(MODELS) == 21
    assert {one["package"] for one in MODELS.values()} == {"lme4", "nlme", "MASS", "datasets"}


def test_the_licence_and_source_of_every_data_set_are_named():
    rows = [
        [cell.strip() for cell in line.strip("|\n").split("|")]
        for line in (FOLDER / "LICENSES.md").read_text().splitlines()
        if line.startswith("| ") and "---" not in line
    ]
    licences = {row[0]: row[2] for row in rows if len(row) == 4}
    packages = {row[0]: row[1] for row in rows if len(row) == 3 and row[0] != "Data set"}
    assert packages == {name: one["package"] for name, one in MODELS.items()}
    assert packages.keys() == {path.stem for path in (FOLDER / "data").iterdir()}
    assert all("GPL" in licences[package] for package in packages.values())


@pytest.mark.parametrize("name", sorted(MODELS))
def test_estimates_and_standard_errors_are_those_of_lme4(name):
    expected = [one for one in table(FOLDER / "fits.csv") if one["name"] == name]
    fixed, spreads = expected[:-2], expected[-2:]
    outcome, columns, groups, people = data_of(name)
    found = reml(outcome, columns.columns, groups, people)
    assert len(fixed) == len(found.estimates)
    errors = np.sqrt(np.diag(found.covariance))
    # a coefficient that is 0 but for rounding has no relative error: its standard error scales it
    for ours, our_error, theirs in zip(found.estimates, errors, fixed, strict=True):
        error = float(theirs["error"])
        assert ours == pytest.approx(float(theirs["estimate"]), rel=RELATIVE, abs=1e-9 * error)
        assert our_error == pytest.approx(error, rel=RELATIVE)
    between, residual = found.ratio * found.residual, found.residual
    assert np.sqrt([between, residual]) == pytest.approx(
        [float(one["estimate"]) for one in spreads], rel=RELATIVE
    )


@pytest.mark.parametrize("name", sorted(MODELS))
def test_robust_errors_and_degrees_of_freedom_are_those_of_clubsandwich(name):
    expected = [one for one in table(FOLDER / "robust.csv") if one["name"] == name]
    outcome, columns, groups, people = data_of(name)
    robust = RobustTests(
        columns.columns, groups, reml(outcome, columns.columns, groups, people).ratio
    )
    coefficients = [one for one in expected if one["what"] == "coefficient"]
    assert len(coefficients) == len(columns.names)
    for place, theirs in enumerate(coefficients):
        ours = robust.coefficient(outcome, place, "")
        assert ours.error == pytest.approx(float(theirs["error"]), rel=RELATIVE)
        assert ours.df == pytest.approx(float(theirs["df"]), rel=RELATIVE)
    terms = [one for one in expected if one["what"] == "term"]
    assert terms or not MODELS[name]["terms"]
    for number, theirs in enumerate(terms, start=1):
        if not theirs["df"] or float(theirs["df"]) < LEAST_DF:
            with pytest.raises(CannotFitError, match="too few participants"):
                robust.wald(outcome, columns.places(number))
            continue
        f, df = robust.wald(outcome, columns.places(number))
        assert (float(f), df[1]) == pytest.approx(
            (float(theirs["error"]), float(theirs["df"])), rel=RELATIVE
        )


@pytest.mark.parametrize("name", [n for n, one in MODELS.items() if not one["numbers"]])
def test_the_columns_of_a_declared_model_are_those_that_were_compared(name):
    model, rows = MODELS[name], table(FOLDER / "data" / f"{name}.csv")
    levels = {key: sorted({row[key] for row in rows}) for key in model["factors"].split()}
    ours = design_of(levels, model["terms"].split(), rows, model["coding"])
    compared = design(model, rows)
    assert sorted(ours.names) == sorted(compared.names)
    for label, column in zip(ours.names, ours.columns.T, strict=True):
        assert (column == compared.columns[:, compared.names.index(label)]).all()
