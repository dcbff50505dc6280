"""The command of lessons: list them, write a starter file, judge what somebody wrote, show a step."""

from __future__ import annotations

import tempfile
import textwrap
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns, look_at
from pipeline.cli.parameters import JsonOption
from pipeline.errors import MclError
from pipeline.outputs import check_output, check_suffix, replacing

if TYPE_CHECKING:
    from pipeline.lessons.exam import Function
    from pipeline.lessons.judging import Group, Judgement, Wrong
    from pipeline.lessons.lesson import Lesson

SHOWN = 3
"""Wrong answers that are shown of each group."""
NOT_RIGHT = 1


def lesson(
    name: Annotated[
        str | None, typer.Argument(metavar="[NAME]", help="A lesson's name, like 6.1; without it they are listed.")
    ] = None,
    check: Annotated[
        Path | None, typer.Option(metavar="FILE.py", help="Compare the function in this file with the reference.")
    ] = None,
    show: Annotated[
        bool, typer.Option("--show", help="Open one step of a filter that uses it, in rerun's viewer; -o writes it.")
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Write the starter file; with --show, the recording."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Learn the algorithms by writing them.

    Without a name, the lessons are listed. With one, the task is shown; -o writes it into a file, with a function to be
    filled in; --check compares what was written with the reference, by numbers and on the embedded log, and says where
    it differs and which mistake that could be. Exit code 0 if it is right, 1 if not.
    """
    if name is None:
        if check or show or output:
            raise typer.BadParameter("name a lesson as well; `mcl lesson` lists them")
        _list(as_json)
        return
    from pipeline.lessons import lesson as find

    chosen = find(name)
    if check is not None and output is not None and not show:
        raise typer.BadParameter("--check writes nothing: give -o alone for a starter file, or with --show")
    right = True if check is None else _check(chosen, check, as_json)
    if show:
        _show(chosen, check, output)
    elif output is not None:
        check_suffix(output, ".py", "the name of a starter file ends in .py")
        _check_output(output)
        with replacing(output) as part:
            part.write_text(chosen.starter(output), encoding="utf-8")
        console.result(str(output))
    elif check is None:
        console.result(chosen.starter(f"{chosen.function}.py").rstrip())
    if not right:
        raise typer.Exit(NOT_RIGHT)


def _list(as_json: bool) -> None:
    from pipeline.lessons import lessons

    if as_json:
        rows = [{"name": each.name, "title": each.title, "function": each.function} for each in lessons()]
        console.emit_json([row | {"source": each.source} for row, each in zip(rows, lessons(), strict=True)])
        return
    told = [(each.name, each.title, each.source) for each in lessons()]
    console.result(columns("lessons, by the tables of Probabilistic Robotics", told, ("name", "title", "read")))
    console.note("begin with one:  mcl lesson 5.6 -o mine.py, then  mcl lesson 5.6 --check mine.py")


def _check(chosen: Lesson, path: Path, as_json: bool) -> bool:
    from pipeline.lessons.judging import judge

    judgement = judge(chosen, path)
    if as_json:
        console.emit_json(judgement.to_dict())
    else:
        console.result("\n".join(_told(judgement)))
    return judgement.right


def _told(judgement: Judgement) -> list[str]:
    """What is said of a judgement, line by line."""
    chosen = judgement.lesson
    word = "right" if judgement.right else "not right yet"
    lines = [f"{judgement.path}: lesson {chosen.name}, {chosen.function}: {word}"]
    width = max(len(group.name) for group in judgement.groups)
    for group in judgement.groups:
        lines += _of_group(group, width)
    lines += _of_log(judgement)
    if judgement.mistakes:
        lines += textwrap.wrap(_diagnosis(judgement), 110, initial_indent="  ", subsequent_indent="    ")
    if judgement.relation:
        lines.append(f"  {judgement.relation}")
    if not judgement.mistakes and not judgement.relation and not judgement.answers_right:
        lines.append("  none of the mistakes that are often made gives these answers")
    return lines


def _of_group(group: Group, width: int) -> list[str]:
    wrong = len(group.wrong)
    told = "right" if not wrong else f"{wrong} of {group.asked} wrong" if group.asked > 1 else "wrong"
    lines = [f"  {group.name:<{width}}  {told}"]
    lines += [f"    {_difference(each)}" for each in group.wrong[:SHOWN]]
    if wrong > SHOWN:
        lines.append(f"    and {wrong - SHOWN} more")
    return lines


def _difference(wrong: Wrong) -> str:
    unit = f" {wrong.question.unit}" if wrong.question.unit else ""
    ratio = wrong.answer / wrong.expected if wrong.expected else 0.0
    of_it = f", {ratio:.3g} times that" if abs(ratio - 1.0) > 0.05 and 1e-6 < abs(ratio) < 1e6 else ""
    return f"{wrong.question.text}: {wrong.answer:.4g}{unit}, should be {wrong.expected:.4g}{of_it}"


def _of_log(judgement: Judgement) -> list[str]:
    if judgement.stopped:
        return [f"  on the embedded log: it comes to no end: {judgement.stopped}"]
    if judgement.outcome is None or judgement.reference is None:
        return []
    lines = [f"  on the embedded log: {judgement.outcome.text}"]
    if not judgement.log_right or not judgement.answers_right:
        lines.append(f"  with the reference:  {judgement.reference.text}")
    return lines


def _diagnosis(judgement: Judgement) -> str:
    texts = "; and ".join(mistake.text for mistake in judgement.mistakes)
    if judgement.explained == judgement.differing:
        return f"this could be: {texts} (every answer is what it would be then)"
    share = f"{judgement.explained} of {judgement.differing} wrong answers are"
    return f"this could be: {texts} ({share} what they would be then)"


def _show(chosen: Lesson, path: Path | None, output: Path | None) -> None:
    from pipeline.lessons.judging import PATIENCE
    from pipeline.lessons.showing import record_step
    from pipeline.lessons.written import Written
    from pipeline.recording.viewer import show

    function: Function = chosen.reference if path is None else Written(path, chosen.function)
    if output is not None:
        check_suffix(output, ".rrd", "the name of a recording ends in .rrd")
        _check_output(output)
        record_step(chosen, function, output, PATIENCE)
        console.note(look_at(output))
        console.result(str(output))
        return
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / f"lesson-{chosen.name}.rrd"
        record_step(chosen, function, recording, PATIENCE)
        show(recording)


def _check_output(output: Path) -> None:
    if output.exists():
        raise MclError("this file exists already", "what was written is never overwritten: name another", path=output)
    check_output(output, force=False)
