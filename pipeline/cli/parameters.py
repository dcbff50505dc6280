"""Options that several commands share, and the command that shows the configuration they amount to."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline import console
from pipeline.errors import MclError
from pipeline.spelling import did_you_mean

if TYPE_CHECKING:
    from pipeline.config import Config
    from pipeline.logs.faults import Fault

MapOption = Annotated[
    Path | None,
    typer.Option("--map", metavar="MAP", help="A beesoft map or a map_server YAML, instead of the log's own map."),
]
ConfigOption = Annotated[
    str | None,
    typer.Option(
        "--config",
        "-c",
        metavar="NAME|FILE",
        help="A preset's name, a YAML file or nav2_params.yaml; see `mcl config`.",
    ),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="A parameter; may be given several times."),
]
ParticlesOption = Annotated[
    int | None, typer.Option(metavar="N", min=1, help="Use so many particles, from the start to the end.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON on stdout instead of a table.")]
ConnectOption = Annotated[
    str | None,
    typer.Option(metavar="URL", help="Show it in a viewer that is open already, like rerun+http://host:9876/proxy."),
]
FaultOption = Annotated[
    list[str] | None,
    typer.Option(
        "--fault",
        metavar="KIND:ARGS",
        help="Make a fault on purpose; the truth stays exact. Repeatable. Moments are seconds since the first scan; "
        "what is left out at the end is drawn by the seed: `turn` is a wrong turn somewhere. "
        "gap:40:60, lines are missing and the odometry goes on; "
        "carried:40:60, the same, and the wheels did not turn meanwhile; "
        "turn:40:90, at 40 s the wheels count 90 degrees to the left too many; "
        "slide:40:1.5:-0.5, the robot slides 1.5 m forwards and 0.5 m to the right, uncounted; "
        "spin:40:42:0.5, the wheels spin, and count 0.5 m/s too much; "
        "dead:40:60, the odometry stands still (dead:40 to the end); "
        "mirrored, turns have the wrong sign; "
        "no-reverse, driving backwards is told as forwards; "
        "scale:0.7, of every metre 0.7 m are told; "
        "restart:40, the odometry begins at zero again; "
        "late:0.3, it is 0.3 s behind the laser; "
        "thin:5, a scan every 5 s.",
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace what is there under the output's name.")]


LATEST = "latest"
"""The newest run, wherever a command takes one."""


def named_run(path: Path) -> Path:
    """The run of that name; ``latest`` is the one whose recording was written last, unless a file has that name."""
    if str(path) != LATEST or path.exists():
        return path
    from pipeline.recording.run_folder import newest

    run = newest()
    console.note(f"latest: {run}")
    return run


def named_runs(paths: list[Path] | None) -> list[Path] | None:
    """The same of several, as typer hands them over."""
    return None if paths is None else [named_run(path) for path in paths]


def asked_faults(texts: list[str] | None) -> tuple[Fault, ...]:
    """What --fault asks for."""
    if not texts:
        return ()
    from pipeline.logs.faults import parse_fault

    return tuple(parse_fault(text) for text in texts)


def effective_config(source: str | None, settings: list[str] | None, particles: int | None, **flags: Any) -> Config:
    """What --config, --set and the flags amount to."""
    from pipeline.config import Config, load_config

    flags["max_particles"] = particles
    if "min_particles" in Config.model_fields:
        flags["min_particles"] = particles
    config = load_config(source, settings or (), remark=_note_once, **flags)
    changed = [f"{name}={value}" for name, value in config if value != Config.model_fields[name].default]
    console.detail(f"parameters: {', '.join(changed) or 'the defaults'}")
    return config


@cache
def _note_once(text: str) -> None:
    """A remark on a file is the same however often its values are varied."""
    console.note(f"note: {text}")


def config(
    source: Annotated[
        str | None,
        typer.Argument(metavar="[NAME|FILE]", help="A preset, a YAML file, or a parameter's name or part of it."),
    ] = None,
    log: Annotated[
        Path | None, typer.Argument(metavar="[LOG]", help="With --check: a log that the file shall fit as well.")
    ] = None,
    settings: SetOption = None,
    presets: Annotated[bool, typer.Option("--list", help="List the presets instead.")] = False,
    check: Annotated[
        bool,
        typer.Option(
            "--check",
            help="Tell instead what is wrong with a file of AMCL's parameters: what nav2 would refuse, what is "
            "contradictory, and what is far from what LOG shows. Exits with 1 if something is broken.",
        ),
    ] = False,
    map_path: MapOption = None,
    as_json: JsonOption = False,
) -> None:
    """Show every parameter, its effective value and what it means.

    With --check it looks at a parameter file of AMCL instead, of nav2 or ROS 1.
    """
    if check:
        from pipeline.cli.checking import check_parameters

        check_parameters(source, log, map_path, as_json)
        return
    for given, option in ((log, "a log"), (map_path, "--map"), (as_json or None, "--json")):
        if given is not None:
            raise MclError(f"{option} goes with --check")
    from pipeline.config import dump_config, load_config, preset_description, preset_names

    if presets:
        width = max(map(len, preset_names()))
        for name in preset_names():
            console.result(f"{name:<{width}}  {preset_description(name)}".rstrip())
        return
    only = _meant_by(source)
    effective = load_config(None if only else source, settings or (), remark=_note_once)
    about = _explanations() | _own_descriptions(effective)
    lines = []
    for line in dump_config(effective).splitlines():
        key = line.partition(":")[0]
        if only and key.partition(".")[0] not in only:
            continue
        if key in about:
            lines.append(f"\n# {about[key]}")
        lines.append(line)
    console.result("\n".join(lines).strip())


def _meant_by(source: str | None) -> list[str]:
    """The parameters that are asked for, by name or by a part of it; none if it is a preset or a file."""
    from pipeline.config import Config, preset_names

    if source in Config.model_fields:
        return [source]
    if source is None or source in preset_names() or Path(source).exists():
        return []
    return [name for name in Config.model_fields if source in name] or _unknown(source)


def _unknown(source: str) -> list[str]:
    """Nothing, for a name that looks like a file's; MclError with the nearest name for any other."""
    from pipeline.config import Config, preset_names

    if "." in source or "/" in source:
        return []
    near = did_you_mean(source, [*preset_names(), *Config.model_fields])
    raise MclError(f"there is no parameter, preset or file {source!r}", near or "mcl config shows all parameters")


def _explanations() -> dict[str, str]:
    """Of every parameter a sentence, and on the next line what it takes, its default and the book's symbol."""
    from pipeline.config import Config
    from pipeline.explained import SYMBOLS, what_is_taken

    schema, found = Config.model_json_schema()["properties"], {}
    for name, field in Config.model_fields.items():
        symbol = f"; the book's {SYMBOLS[name]}" if name in SYMBOLS else ""
        default = json.dumps(field.default)
        found[name] = f"{field.description}\n# {what_is_taken(name, schema[name])}; default {default}{symbol}"
    return found


def _own_descriptions(config: Config) -> dict[str, str]:
    """What is said of the parameters of parts of the user's own."""
    from pipeline.parts.roles import ROLES

    found: dict[str, str] = {}
    for role in ROLES:
        if written := config.written(role):
            part, values = written
            found |= {
                f"{role}.{key}": part.parameters[key].description or f"A parameter of {part.short}." for key in values
            }
    return found
