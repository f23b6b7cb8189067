"""Mixed models agree with lme4 on 21 data sets that come with R (tests/support/analysis/lme4/), and
the degrees of freedom of their tests with nlme.

Both maximize the same restricted likelihood, so the optima are the same, also in Dyestuff2
and CO2, whose groups do not differ beyond chance (the variance is 0).
"""

import csv
from itertools import product

import numpy as np
import pytest

from experiments.analysis.statistics.mixed_models import INTERCEPT, Design, design_of, fit
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


def fitted(name):
    rows = table(FOLDER / "data" / f"{name}.csv")
    model = MODELS[name]
    outcome = np.array([float(row["outcome"]) for row in rows])
    return fit(outcome, design(model, rows), model["terms"].split(), [row["who"] for row in rows])


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
    found = fitted(name)
    assert len(fixed) == len(found.coefficients)
    # a coefficient that is 0 but for rounding has no relative error: its standard error scales it
    for ours, theirs in zip(found.coefficients, fixed, strict=True):
        error = float(theirs["error"])
        assert ours.estimate.value == pytest.approx(
            float(theirs["estimate"]), rel=RELATIVE, abs=1e-9 * error
        )
        assert ours.error == pytest.approx(error, rel=RELATIVE)
    assert (found.sd_participants, found.sd_residual) == pytest.approx(
        [float(one["estimate"]) for one in spreads], rel=RELATIVE
    )


@pytest.mark.parametrize("name", sorted(MODELS))
def test_degrees_of_freedom_are_those_of_nlme(name):
    expected = [one for one in table(FOLDER / "freedom.csv") if one["name"] == name]
    found = fitted(name)
    coefficients = [float(one["df"]) for one in expected if one["what"] == "coefficient"]
    terms = [float(one["df"]) for one in expected if one["what"] == "term"]
    assert [one.df for one in found.coefficients] == coefficients
    assert [one.df[1] for one in found.terms] == terms[1:]  # no test of the intercept as a term


@pytest.mark.parametrize("name", [n for n, one in MODELS.items() if not one["numbers"]])
def test_the_columns_of_a_declared_model_are_those_that_were_compared(name):
    model, rows = MODELS[name], table(FOLDER / "data" / f"{name}.csv")
    levels = {key: sorted({row[key] for row in rows}) for key in model["factors"].split()}
    ours = design_of(levels, model["terms"].split(), rows, model["coding"])
    compared = design(model, rows)
    assert sorted(ours.names) == sorted(compared.names)
    for label, column in zip(ours.names, ours.columns.T, strict=True):
        assert (column == compared.columns[:, compared.names.index(label)]).all()
