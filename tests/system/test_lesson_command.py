"""`mcl lesson`, as students and teachers type it; and the sub-steps and the warning of `mcl localize`."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from commands import FEW, Command, Journey

from pipeline.lessons import lesson, lessons
from pipeline.recording import entities
from pipeline.recording.rrd_file import read_rrd

RIGHT = Path(__file__).parents[1] / "lessons" / "right"


def test_the_list_names_every_lesson(typed_here: Command) -> None:
    said = typed_here("lesson").stdout
    assert all(each.name in said and each.title in said for each in lessons())
    listed = json.loads(typed_here("lesson", "--json").stdout)
    assert [row["name"] for row in listed] == [each.name for each in lessons()]


def test_a_name_shows_the_task(typed_here: Command) -> None:
    assert "def low_variance_sampler(weights, rng):" in typed_here("lesson", "4.4").stdout


def test_a_starter_is_written_and_never_overwritten(typed_here: Command, tmp_path: Path) -> None:
    typed_here("lesson", "6.1", "-o", "mine.py", cwd=tmp_path)
    written = (tmp_path / "mine.py").read_text()
    assert written == lesson("6.1").starter("mine.py")
    done = typed_here("lesson", "6.1", "-o", "mine.py", cwd=tmp_path, code=1)
    assert "never overwritten" in done.stderr
    assert (tmp_path / "mine.py").read_text() == written
    done = typed_here("lesson", "6.1", "--check", "mine.py", cwd=tmp_path, code=1)
    assert "is not written yet" in done.stderr
    assert done.stderr.count("\n") == 1


def test_what_is_right_is_told_so(typed_here: Command) -> None:
    done = typed_here("lesson", "8.4", "--check", RIGHT / "kld_plain.py")
    assert done.stdout.splitlines()[0].endswith("lesson 8.4, kld_particles: right")
    assert "on the embedded log: the estimate is" in done.stdout


def test_what_is_wrong_is_told_with_where_by_how_much_and_why(typed_here: Command, tmp_path: Path) -> None:
    source = (RIGHT / "beam_model_loop.py").read_text()
    (tmp_path / "mine.py").write_text(source.replace("if measured <= true:", "if True:"))
    said = typed_here("lesson", "6.1", "--check", "mine.py", cwd=tmp_path, code=1).stdout
    assert "not right yet" in said
    assert "behind the wall" in said
    assert "4 of 4 wrong" in said
    assert "should be" in said
    assert "this could be: p_short is not cut off at z*" in said
    judged = json.loads(typed_here("lesson", "6.1", "--check", "mine.py", "--json", cwd=tmp_path, code=1).stdout)
    assert judged["right"] is False
    assert judged["mistakes"] == ["p_short is not cut off at z*"]
    assert judged["log"]["yours"] > 0.0


@pytest.mark.parametrize("name", ["4.4", "5.6", "7.2", "8.1"])
def test_a_step_is_written_as_a_recording(typed_here: Command, tmp_path: Path, name: str) -> None:
    typed_here("lesson", name, "--show", "-o", "step.rrd", cwd=tmp_path)
    file = read_rrd(tmp_path / "step.rrd")
    rows = [chunk for chunk in file.chunks if entities.SUBSTEP in chunk.timeline_names]
    assert entities.SUBSTEP_TEXT in {chunk.entity_path for chunk in rows}


def test_a_step_of_somebodys_own_function_is_shown(typed_here: Command, tmp_path: Path) -> None:
    own = ("--check", RIGHT / "low_variance_vectorised.py")
    done = typed_here("lesson", "4.4", *own, "--show", "-o", "step.rrd", cwd=tmp_path)
    assert "right" in done.stdout
    assert (tmp_path / "step.rrd").exists()


@pytest.mark.parametrize(
    ("typed", "code", "said"),
    [
        ("lesson 9.9", 1, "there is no lesson '9.9' (there are 4.4, ess,"),
        ("lesson --check mine.py", 2, "name a lesson as well"),
        ("lesson 4.4 --check nosuch.py", 1, "nosuch.py: No such file"),
        ("lesson 4.4 -o mine.txt", 1, "mine.txt: the name of a starter file ends in .py"),
        ("lesson 4.4 --show -o step.txt", 1, "step.txt: the name of a recording ends in .rrd"),
        ("localize office.mcap --substeps 3", 2, "'3' is not FROM:TO in seconds"),
        ("localize office.mcap --substeps 5:3", 2, "'5:3' is not FROM:TO in seconds"),
        ("localize office.mcap --substeps 1:2 --no-record", 2, "--no-record leaves nothing to put --substeps into"),
    ],
)
def test_bad_input_is_one_line(typed_here: Command, tmp_path: Path, typed: str, code: int, said: str) -> None:
    assert said in " ".join(typed_here(*typed.split(), cwd=tmp_path, code=code).stderr.split()).replace("│ ", "")


def test_sub_steps_are_recorded_and_change_no_result(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    mcl("localize", journey.log, *FEW, "--seed", 1, "--threads", 1, "--substeps", "2:3", "-o", tmp_path / "run")
    for name in ("trajectory.tum", "trajectory_hindsight.tum"):
        assert (tmp_path / "run" / name).read_bytes() == (journey.run / name).read_bytes()
    told = read_rrd(tmp_path / "run" / "run.rrd")
    parts = {c.entity_path for c in told.chunks if entities.SUBSTEP in c.timeline_names}
    assert {entities.SUBSTEP_PARTICLES, entities.SUBSTEP_MOVES, entities.COMB_TEETH} <= parts
    plain = read_rrd(journey.run / "run.rrd")
    assert not [c for c in plain.chunks if entities.SUBSTEP in c.timeline_names]
    said = mcl("inspect", tmp_path / "run").stdout
    assert entities.SUBSTEP_PARTICLES in said
    mcl("export", tmp_path / "run", "-o", tmp_path / "run.png")
    done = mcl("localize", journey.log, *FEW, "--substeps", "900:950", "-o", tmp_path / "none", code=1)
    assert "there is no scan between 900 s and 950 s" in done.stderr
    assert not (tmp_path / "none").exists()


def test_the_courses_preset_warns(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    quick = ("--config", "course", "--particles", 100, "--no-record", "--set", "hindsight=false")
    done = mcl("localize", journey.log, *quick, "-o", tmp_path / "run")
    (line,) = (line for line in done.stderr.splitlines() if "the preset course" in line)
    assert line.startswith("warning: ")
    assert "seed" in line
