"""Tables hold what the recording holds."""

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest

from pipeline.errors import MclError
from pipeline.export.files import Wishes, export


def test_tum_is_that_of_the_run_byte_for_byte(run, folder, tmp_path):
    export(run, tmp_path / "out.tum")
    assert (tmp_path / "out.tum").read_bytes() == folder.trajectory.read_bytes()


def test_parquet_has_a_row_per_scan_to_full_precision(run, tmp_path):
    export(run, tmp_path / "out.parquet")
    table = pyarrow.parquet.read_table(tmp_path / "out.parquet")
    assert table["stamp"].to_pylist() == run.told.stamps.tolist()
    assert (np.column_stack([table[k] for k in ("x", "y", "yaw")]) == run.told.poses).all()
    assert (np.array(table["cov_x_y"]) == run.told.covariances[:, 0, 1]).all()
    assert np.allclose(table["true_x"], run.told.poses[:, 0], atol=60.0)
    assert {"ess", "particles", "likelihood", "explained", "spread"} <= set(table.column_names)
    assert [text for text in table["event"].to_pylist() if text] == [event.text for event in run.told.events]


def test_csv_says_the_same_as_parquet(run, tmp_path):
    for name in ("out.csv", "out.parquet"):
        export(run, tmp_path / name)
    read, exact = pyarrow.csv.read_csv(tmp_path / "out.csv"), pyarrow.parquet.read_table(tmp_path / "out.parquet")
    assert read.column_names == exact.column_names
    for name in ("stamp", "time", "x", "yaw", "explained"):
        assert read[name].to_pylist() == exact[name].to_pylist()


def test_particles_are_a_table_of_their_own(run, tmp_path):
    export(run, tmp_path / "out.parquet", Wishes(particles=True))
    table = pyarrow.parquet.read_table(tmp_path / "out.parquet")
    assert len(table) == 150 * 30
    assert set(table.column_names) == {"scan", "time", "x", "y", "yaw", "log10_weight"}
    last = table.filter(np.array(table["scan"]) == 149)
    assert np.median(last["x"]) == pytest.approx(run.told.poses[-1, 0], abs=0.5)
    assert -2.0 < np.min(table["log10_weight"]) < np.max(table["log10_weight"]) < 2.0


@pytest.mark.parametrize(
    ("name", "wishes", "said"),
    [
        ("out.txt", Wishes(), "the suffix says"),
        ("out.tum", Wishes(at=[1.0]), "--at asks for a picture"),
        ("out.png", Wishes(particles=True), "--particles asks for a table"),
        ("none/out.png", Wishes(), "does not exist"),
        ("out.png", Wishes(size=(10, 10)), "pixels along a side"),
        ("out.png", Wishes(at=[1e9]), "no estimate at"),
    ],
)
def test_what_cannot_be_is_said_in_a_line(run, tmp_path, name, wishes, said):
    with pytest.raises(MclError, match=said):
        export(run, tmp_path / name, wishes)
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_replaced_unasked(run, tmp_path):
    path = tmp_path / "out.csv"
    path.write_text("precious")
    with pytest.raises(MclError, match="exists already"):
        export(run, path)
    assert path.read_text() == "precious"
    export(run, path, force=True)
    assert path.read_text().startswith('"scan"')
    assert [p.name for p in tmp_path.iterdir()] == ["out.csv"]
