"""What the report on a study in the database says, computed once more by pandas and scipy from the
files of its export alone.
"""

import io

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from experiments.analysis.report import reports
from experiments.dataset.folder import read
from experiments.export.files import export_files
from experiments.extraction.build import dataset_of
from experiments.extraction.selection import Selection
from tests.support.analysis.study_dataset import made_up
from tests.support.studies.study_rows import put

pytestmark = pytest.mark.django_db
STATEMENTS = [f"q{n}" for n in range(1, 9)]


def frames(study) -> dict[str, pd.DataFrame]:
    """The tables of an export by the names of their files."""
    found = {}
    for name, parts in export_files(study, Selection()):
        content = b"".join(parts)
        if name.endswith("_data.csv") and name.count("/") == 1:
            found[name.split("-", 1)[1].removesuffix("_data.csv")] = pd.read_csv(
                io.BytesIO(content)
            )
    return found


def value(table, row: str, column: str) -> float | None:
    (cells,) = (cells for cells in table.rows if cells[0].text == row)
    return cells[table.head.index(column)].value


@pytest.mark.parametrize("participants", [0, 1, 9])
def test_tables_agree_with_pandas_and_scipy(participants):
    stored = put(made_up(np.random.default_rng(61), participants))
    (report,) = reports(dataset_of(stored.study))
    tables = {table.name: table for table in report.tables}
    found = frames(stored.study)

    sessions = found["sessions"][found["sessions"]["counts"] == 1]
    first = (
        found["experience"]
        .merge(sessions[["id", "visit"]], left_on="session", right_on="id")
        .sort_values("visit")
    )
    first = first.groupby("participant").first()
    means = first[STATEMENTS].mean(axis=1).dropna()
    pooled = first[STATEMENTS].stack().dropna()
    overall = tables["table-5"]
    assert value(overall, "Overall", "n") == len(means)
    if len(means) > 1:
        assert value(overall, "Overall", "Mean") == pytest.approx(means.mean())
        assert value(overall, "Overall", "SD") == pytest.approx(means.std(ddof=1))
        c = (
            stats.norm.ppf(0.975)
            if stored.study.as_definition().analysis.interval == "normal"
            else stats.t.ppf(0.975, len(means) - 1)
        )
        assert value(overall, "Overall", "CI95") == pytest.approx(
            c * means.std(ddof=1) / np.sqrt(len(means))
        )
        assert value(overall, "Overall", "% +2") == pytest.approx(
            100.0 * (pooled == 2).mean(), abs=0.11
        )
        q7 = first["q7"].dropna()
        assert value(overall, "Q7", "n") == len(q7)
        assert value(overall, "Q7", "Mean") == pytest.approx(q7.mean())

    metrics = found["metrics"][found["metrics"]["session"].isin(sessions["id"])]
    for name in ("total_time", "path", "speed", "stops", "command_age", "round_trip"):
        known = metrics[name].dropna()
        assert value(tables["metrics"], name, "n") == len(known)
        if len(known):
            assert value(tables["metrics"], name, "Median") == pytest.approx(known.median())
            assert value(tables["metrics"], name, "p95") == pytest.approx(known.quantile(0.95))
    once = sessions.drop_duplicates(["participant", "condition"])
    assert value(tables["outcomes"], "all", "Sessions") == len(once)
    if len(once):
        assert value(tables["outcomes"], "all", "% completed") == pytest.approx(
            100.0 * (once["outcome"] == "completed").mean()
        )


def test_a_way_and_its_mean_speed_agree_with_pandas(tmp_path):
    stored = put(made_up(np.random.default_rng(62), 1))
    for name, parts in export_files(stored.study, Selection()):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"".join(parts))
    metrics = pd.read_csv(tmp_path / "data" / "description-metrics_data.csv").set_index("session")
    checked = 0
    for session in read(tmp_path).sessions:
        path = tmp_path / "data" / "states" / f"session-{session.id}_data.csv"
        if not path.exists():
            continue
        states = pd.read_csv(path)
        at = states["stamp"] - states["clock_offset"].median()
        within = states[(at >= session.first_frame) & (at <= session.ended)]
        assert metrics.loc[session.id, "path"] == pytest.approx(
            np.hypot(within["x"].diff(), within["y"].diff()).sum(), rel=0.05
        )
        assert metrics.loc[session.id, "commands"] == pytest.approx(
            within["commands"].sum(), rel=0.02
        )
        checked += 1
    assert checked
