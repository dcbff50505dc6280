"""Whether a parameter file of AMCL contradicts itself: what nav2 would refuse, what it would mend, what is idle."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from pipeline.check.findings import Finding, Grade
from pipeline.errors import MclError
from pipeline.nav2 import (
    DEFAULTS,
    OF_EVERY_NODE,
    PARAMETERS,
    Given,
    given_in,
    given_of_layout,
    is_amcl,
    is_launch,
    layout_of,
    lines_of,
    load,
    values_of_launch,
)
from pipeline.spelling import did_you_mean

LARGEST: Final = 1e300
"""What is larger, or no number, is not meant."""
ABOUT_ONE: Final = 0.15
"""nav2's own defaults add up to 1.1 for the beam model."""
FAR: Final = 1.0
"""m and rad: a robot that moves so far between two updates may have passed a door, or turned from all it saw."""


@dataclass(frozen=True)
class Checked:
    """AMCL's parameters in a file, and on which line each stands, where that is known."""

    given: Given
    lines: dict[str, int]

    def finding(self, grade: Grade, name: str, text: str, do: str) -> Finding:
        """A finding about one parameter, with its line."""
        place = f"line {self.lines[name]}: " if name in self.lines else ""
        return Finding(grade, self.given.name(name), f"{place}{text}", do)

    def said(self, *names: str) -> bool:
        """Whether the file itself gives one of them."""
        return any(name in self.given.values for name in names)


def checked(path: Path) -> tuple[Checked, list[Finding]]:
    """A file, read as it would be for a run, and what was remarked on the way.

    Raises MclError if there is none, or nothing of AMCL in it.
    """
    try:
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise MclError(f"cannot be read: {error.strerror or error}", path=path) from error
    except UnicodeDecodeError as error:
        raise MclError("not a text file", "expected parameters of AMCL", path=path) from error
    remarks: list[str] = []
    if is_launch(text):
        given = given_in(values_of_launch(text, path, remarks.append), path)
        assert given is not None
        lines: dict[str, int] = {}
    else:
        layout = layout_of(text, path)
        if layout.blocks:
            given, lines = given_of_layout(layout), lines_of(layout)
            if not given.values and not any(map(is_amcl, layout.blocks)):
                has = ", ".join(layout.blocks)
                raise MclError(f"no parameters of 'amcl' in this ROS file: it has {has}", path=path)
        else:
            found = given_in(load(text, path), path)
            if found is None:
                raise MclError("no parameters of AMCL in this file", "expected nav2's, or those of ROS 1", path=path)
            given, lines = found, {}
    remarks += given.remarks
    said = [Finding("noted", "reading", _sentence(remark), "Nothing, if that is meant.") for remark in remarks]
    return Checked(given, lines), said


def findings_of_file(file: Checked) -> Iterator[Finding]:
    """What is wrong with the file whatever the log; types and names first, without which the rest says nothing."""
    yield from _names(file)
    yield from _types_and_bounds(file)
    file = sound(file)  # what is wrong by itself is told once
    yield from _particles(file)
    yield from _ranges(file)
    yield from _weights(file)
    yield from _updates(file)
    yield from _recovery(file)
    yield from _start(file)
    yield from _frames(file)


def sound(file: Checked) -> Checked:
    """The file with what AMCL would take: a number of the wrong kind is mended, and a default stands for the rest."""
    values = {}
    for name, value in file.given.values.items():
        parameter = PARAMETERS.get(name)
        if parameter is not None and parameter.wrong_type(value) and _is_meant(parameter.kind, value):
            value = float(value) if parameter.kind == "double" else int(value)
        if parameter is None or not (parameter.wrong_type(value) or parameter.wrong_value(value)):
            values[name] = value
    return replace(file, given=replace(file.given, values=values))


def _names(file: Checked) -> Iterator[Finding]:
    for name in file.given.unknown():
        near = did_you_mean(name, [*map(file.given.name, PARAMETERS), *OF_EVERY_NODE])
        do = near[0].upper() + near[1:] if near else "Take it out, or look up its name in nav2's configuration guide."
        yield file.finding("doubtful", name, f"AMCL has no parameter {name}: it is not read.", do)


def _types_and_bounds(file: Checked) -> Iterator[Finding]:
    for name, value in file.given.values.items():
        parameter = PARAMETERS.get(name)
        if parameter is None:
            continue
        if wrong := parameter.wrong_type(value):
            text = f"{file.given.name(name)} is {_plain(value)}, of type {wrong}; AMCL wants {_a(parameter.kind)}."
            meant = parameter.written(value) if _is_meant(parameter.kind, value) else _a(parameter.kind)
            yield file.finding("broken", name, f"{text} nav2 refuses the file at the start.", f"Write {meant}.")
        elif expected := parameter.wrong_value(value):
            text = f"{file.given.name(name)} is {_plain(value)}; expected {expected}."
            # An unknown laser model is silently the default one, and a few other numbers are mended with a warning.
            yield file.finding("broken", name, text, f"AMCL's default is {_plain(parameter.default)}.")


def _particles(file: Checked) -> Iterator[Finding]:
    least, most = file.given.number("min_particles"), file.given.number("max_particles")
    if least > most:
        yield file.finding(
            "broken", "min_particles" if file.said("min_particles") else "max_particles",
            f"min_particles ({least:g}) is more than max_particles ({most:g}); AMCL takes min_particles for both.",
            "Raise max_particles, or lower min_particles.",
        )  # fmt: skip


def _ranges(file: Checked) -> Iterator[Finding]:
    shortest, longest = file.given.number("laser_min_range"), file.given.number("laser_max_range")
    if 0.0 < longest <= shortest:
        yield file.finding(
            "broken", "laser_min_range" if file.said("laser_min_range") else "laser_max_range",
            f"laser_min_range ({shortest:g} m) is not below laser_max_range ({longest:g} m): no reading counts.",
            "Set laser_min_range below laser_max_range; -1.0 is the laser's own limit.",
        )  # fmt: skip


def _weights(file: Checked) -> Iterator[Finding]:
    given, model = file.given, file.given.get("laser_model_type")
    names = ("z_hit", "z_short", "z_max", "z_rand") if model == "beam" else ("z_hit", "z_rand")
    first = next((name for name in names if file.said(name)), names[0])
    total = sum(given.number(name) for name in names)
    named = " + ".join(given.name(name) for name in names)
    if total <= 0.0:
        yield file.finding("broken", first, f"{named} is 0: all poses weigh the same.", "Let them add up to 1.")
    elif abs(total - 1.0) > ABOUT_ONE:
        yield file.finding(
            "doubtful", first,
            f"{named} is {total:.3g}, and AMCL normalises nothing: with laser_model_type {model} these should add up "
            "to about 1.",
            f"Divide each by {total:.3g}.",
        )  # fmt: skip
    if given.flag("do_beamskip") and model != "likelihood_field_prob":
        yield file.finding(
            "doubtful", "do_beamskip", f"do_beamskip has no effect with laser_model_type {model}.",
            "Only likelihood_field_prob skips beams: change the model, or set do_beamskip to false.",
        )  # fmt: skip
    sigma, reach = given.number("sigma_hit"), given.number("laser_likelihood_max_dist")
    if model != "beam" and sigma >= reach:
        yield file.finding(
            "broken", "sigma_hit" if file.said("sigma_hit") else "laser_likelihood_max_dist",
            f"{given.name('sigma_hit')} ({sigma:g} m) is not below laser_likelihood_max_dist ({reach:g} m): the field "
            "is nearly flat everywhere, and all poses weigh about the same.",
            "Lower the one to some centimetres or decimetres, or raise the other.",
        )  # fmt: skip


def _updates(file: Checked) -> Iterator[Finding]:
    given = file.given
    d, a, reach = (given.number(name) for name in ("update_min_d", "update_min_a", "laser_likelihood_max_dist"))
    for name, far, unit in (("update_min_d", d, "m"), ("update_min_a", a, "rad")):
        if far > FAR:
            yield file.finding(
                "doubtful", name,
                f"{name} is {far:g} {unit}: so far the robot moves by its wheels alone between two looks at the laser.",
                f"AMCL's default is {DEFAULTS[name]:g} {unit}; mcl tune finds one for your robot.",
            )  # fmt: skip
    if d == 0.0 and a == 0.0:
        yield file.finding(
            "doubtful", "update_min_d",
            "update_min_d and update_min_a are 0: a robot that stands still is updated at every scan, and its "
            "particles fall together onto one that need not be right.",
            "Set both to a few centimetres and hundredths of a radian.",
        )  # fmt: skip
    spread = math.sqrt(given.number("alpha3") * d * d + given.number("alpha4") * a * a)
    if given.get("laser_model_type") != "beam" and spread > reach:
        yield file.finding(
            "broken", "alpha3" if file.said("alpha3") else "alpha4",
            f"By alpha3 and alpha4 particles spread by {spread:.1f} m in one update, farther than "
            f"laser_likelihood_max_dist ({reach:g} m), within which the field tells them apart.",
            "Lower the alphas: mcl tune learns them.",
        )  # fmt: skip


def _recovery(file: Checked) -> Iterator[Finding]:
    slow, fast = (file.given.number(f"recovery_alpha_{word}") for word in ("slow", "fast"))
    name = "recovery_alpha_fast" if file.said("recovery_alpha_fast") else "recovery_alpha_slow"
    if (slow > 0.0) != (fast > 0.0):
        yield file.finding(
            "doubtful", name,
            f"recovery_alpha_slow is {slow:g} and recovery_alpha_fast {fast:g}: one average stays at what the first "
            "scan said.",
            "Set both, 0.001 and 0.1 for example, or both to 0.0.",
        )  # fmt: skip
    elif slow > 0.0 and slow >= fast:
        yield file.finding(
            "broken", name,
            f"recovery_alpha_slow ({slow:g}) is not below recovery_alpha_fast ({fast:g}): random poses join when the "
            "robot gets on well, and none when it is lost.",
            "The slow rate is the smaller one: 0.001 and 0.1 for example.",
        )  # fmt: skip


def _start(file: Checked) -> Iterator[Finding]:
    pose = [f"initial_pose.{axis}" for axis in ("x", "y", "yaw")]
    if file.given.flag("set_initial_pose") and not file.said(*pose):
        yield file.finding(
            "doubtful", "set_initial_pose",
            "set_initial_pose is true, and no initial_pose is given: AMCL starts at 0, 0, 0.",
            "Give initial_pose with x, y and yaw, or set set_initial_pose to false.",
        )  # fmt: skip
    if file.said(*pose) and not file.given.flag("set_initial_pose"):
        yield file.finding(
            "doubtful", next(name for name in pose if file.said(name)),
            "An initial_pose is given, and set_initial_pose is false: AMCL does not use it.",
            "Set set_initial_pose to true, or take the pose out.",
        )  # fmt: skip


def _frames(file: Checked) -> Iterator[Finding]:
    names = ("global_frame_id", "odom_frame_id", "base_frame_id")
    frames = {name: str(file.given.get(name)).lstrip("/") for name in names}
    for i, one in enumerate(names):
        for other in names[i + 1 :]:
            if frames[one] == frames[other]:
                yield file.finding(
                    "broken", one if file.said(one) else other,
                    f"{one} and {other} are both {frames[one]!r}: there is no transform between them to publish.",
                    "Give each frame its own name: map, odom and base_footprint or base_link.",
                )  # fmt: skip
    if not file.given.flag("tf_broadcast"):
        yield file.finding(
            "noted", "tf_broadcast", "tf_broadcast is false: nobody publishes the transform from map to odom.",
            "Nothing, if another node does.",
        )  # fmt: skip


def _is_meant(kind: str, value: Any) -> bool:
    """Whether it is plain what was meant: a number of the other kind."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return False
    if not abs(value) <= LARGEST:
        return False
    return kind == "double" or (kind == "integer" and value == int(value))


def _a(kind: str) -> str:
    words = {"double": "a double, with its point", "integer": "an integer", "bool": "true or false"}
    return words.get(kind, "a text")


def _plain(value: Any) -> str:
    words = {bool: str(value).lower(), str: repr(value), type(None): "nothing"}
    return words.get(type(value), f"{value}")


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."
