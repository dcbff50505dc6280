"""Parts by name: a built-in one, a file's (``my_laser.py:Model``), a module's, or that of an installed package."""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import inspect
import sys
import traceback
import typing
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, ValidationError, create_model
from pydantic.fields import FieldInfo

from pipeline.errors import MclError
from pipeline.parts.roles import OFFERED, Method, Role
from pipeline.spelling import did_you_mean
from pipeline.wrong_values import expectation

PAGE = "docs/own_parts.md"
PLAIN = (bool, int, float, str)
"""Types of own parameters that a configuration file can hold."""


def check_name(role: Role, name: str) -> str:
    """The name of a part as it is kept: that of a file becomes absolute, so that it means the same from any folder.

    Raises ValueError for a name that is neither built in, nor installed, nor of the form of an own part's.
    """
    if name in role.built_in:
        return name
    where, colon, what = name.rpartition(":")
    if colon and where and what.isidentifier():
        return f"{Path(where).expanduser().absolute()}:{what}" if where.endswith(".py") else name
    installed = sorted(_installed(role))
    if name in installed:
        return name
    known = [*role.built_in, *installed]
    if name.endswith(".py"):
        raise ValueError(f"a file alone names no part of it: write {_parts_of(Path(name).expanduser())}")
    meant = f"{near} " if (near := did_you_mean(name, known)) else ""
    expected = f"{', '.join(known)}, or a part" if known else "a part"
    raise ValueError(f"{meant}expected {expected} of your own as FILE.py:NAME or MODULE:NAME")


def _parts_of(path: Path) -> str:
    """What a file could be meant for: each function and class in it as it would be named."""
    if not path.is_file():
        return f"{path}:NAME (there is no such file here)"
    names = _defined(module_of(path.absolute()))
    return " or ".join(f"{path}:{name}" for name in names) or f"{path}:NAME (it has no function and no class)"


def _defined(module: Any) -> list[str]:
    """Functions and classes that are written in a module, those for its own use left out."""
    return [
        key
        for key, value in vars(module).items()
        if callable(value) and getattr(value, "__module__", None) == module.__name__ and not key.startswith("_")
    ]


def built_in(role: Role, name: str) -> Any:
    """The class or function of a built-in part."""
    module, _, attribute = role.built_in[name].partition(":")
    return getattr(importlib.import_module(module), attribute)


def load(role: Role, name: str) -> Part:
    """The user's part of that name. Raises MclError, with file and line, if it is not there, or cannot be used."""
    if name in _installed(role):
        point = _installed(role)[name]
        try:
            return _checked(role, name, point.load())
        except MclError:
            raise
        except Exception as error:
            raise MclError(f"{role.name} {name}, of an installed package, cannot be loaded: {told(error)}") from error
    where, _, attribute = name.rpartition(":")
    module = module_of(Path(where)) if where.endswith(".py") else _from_module(where, role)
    if not hasattr(module, attribute):
        there = _defined(module)
        hint = did_you_mean(attribute, there) or f"it has {', '.join(there) or 'no function and no class'}"
        raise MclError(f"{role.name}: there is no {attribute!r} in it", hint, path=where)
    return _checked(role, name, getattr(module, attribute))


@dataclass(frozen=True)
class Part:
    """A user's part as it was written: ``target`` is the function or class, ``method`` what it does."""

    role: Role
    name: str
    target: Any
    method: Method

    @property
    def is_class(self) -> bool:
        """Whether objects have to be made of it first."""
        return inspect.isclass(self.target)

    @property
    def short(self) -> str:
        """Its name without the file or module."""
        return self.name.rpartition(":")[2]

    @staticmethod
    def arguments(target: Any) -> list[str]:
        """The names of what it takes."""
        return list(_signature(target).parameters)

    @property
    def place(self) -> tuple[Path | None, int | None]:
        """The file and line in which it is written, where that is known."""
        try:
            source = inspect.unwrap(getattr(self.target, "py_func", self.target))
            return Path(inspect.getsourcefile(source) or ""), inspect.getsourcelines(source)[1]
        except (OSError, TypeError):
            return None, None

    @property
    def sha256(self) -> str | None:
        """Checksum of the file in which it is written."""
        path, _ = self.place
        return None if path is None or not path.is_file() else hashlib.sha256(path.read_bytes()).hexdigest()

    @property
    def parameters(self) -> dict[str, FieldInfo]:
        """Its own parameters: of the function, or of the constructor, those with a default; not what it is given."""
        found = {}
        given = self.role.made_of if self.is_class else (*self.method.offers, *self.role.made_of)
        for parameter in _signature(self.target).parameters.values():
            if parameter.default is parameter.empty or parameter.name in given:
                continue
            if isinstance(parameter.default, FieldInfo):
                found[parameter.name] = parameter.default
                continue
            annotation = self._hints.get(parameter.name, type(parameter.default))
            found[parameter.name] = FieldInfo.from_annotated_attribute(annotation, parameter.default)
        return found

    @property
    def _hints(self) -> dict[str, Any]:
        target = self.target.__init__ if self.is_class else getattr(self.target, "py_func", self.target)
        try:
            return typing.get_type_hints(target, include_extras=True)
        except Exception:  # of annotations that mean something to others only
            return {}

    def settled(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """All of its own parameters: those ``given``, by name, and the defaults of the others.

        Raises MclError for a name that it has not, and for a value that is not of the parameter's type or bounds.
        """
        known = self.parameters
        for key in given:
            if key not in known:
                near = did_you_mean(key, known)
                hint = near.replace("'", f"'{self.role.name}.", 1) or f"it has {', '.join(known) or 'none'}"
                if self.is_class and not near:
                    hint += "; of a class they stand in the constructor"
                raise MclError(f"{self.name} has no parameter {key!r}", hint)
        fields: dict[str, Any] = {key: (field.annotation, field) for key, field in known.items()}
        model = create_model("Own", __config__=ConfigDict(extra="forbid", allow_inf_nan=False), **fields)
        try:
            values = model.model_validate(dict(given)).model_dump()
        except ValidationError as error:
            first = error.errors()[0]
            key = f"{self.role.name}.{first['loc'][0]}" if first["loc"] else self.role.name
            whole = "" if first["type"] != "int_from_float" else "its default is a whole number: write it with a point"
            raise MclError(f"{key}: {expectation(first)}, got {first['input']!r}", whole) from error
        for key, value in values.items():
            if not isinstance(value, PLAIN) and value is not None:
                path, line = self.place
                said = (
                    f"the parameter {key!r} has the default {value!r}, and only numbers, texts and yes or no can be set"
                )
                raise MclError(said, path=path, line=line)
        return values


def told(error: BaseException) -> str:
    """What an exception says, in one line."""
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


def line_of(error: BaseException, path: Path | str | None) -> int | None:
    """The last line of that file that the exception came through."""
    if isinstance(error, SyntaxError) and error.filename and Path(error.filename) == Path(path or ""):
        return error.lineno
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__) if frame.filename == str(path)]
    return lines[-1] if lines else None


def _checked(role: Role, name: str, target: Any) -> Part:
    """The part, if it can fill the role."""
    if not callable(target):
        raise MclError(f"{role.name} {name} is neither a function nor a class")
    bare = Part(role, name, target, role.methods[0])
    path, line = bare.place
    if bare.is_class:
        method = next((method for method in role.methods if callable(getattr(target, method.name, None))), None)
        if method is None:
            needed = " or ".join(f"{method.name}({', '.join(method.leads)})" for method in role.methods)
            raise MclError(f"{bare.short} has no method {needed}", path=path, line=line)
        _check_names(_signature(target).parameters, 0, set(role.made_of), bare)
        takes = dict(_signature(getattr(target, method.name)).parameters)
        if not isinstance(inspect.getattr_static(target, method.name), staticmethod):
            takes.pop(next(iter(takes), ""), None)  # the object itself
        _check_names(takes, len(method.leads), {*method.offers, *role.made_of}, bare)
        return replace(bare, method=method)
    return replace(bare, method=_meant(bare))


def _meant(part: Part) -> Method:
    """The method as which a plain function is meant."""
    role, parameters = part.role, _signature(part.target).parameters
    path, line = part.place
    _check_plain(part, parameters)
    needed = [key for key, parameter in parameters.items() if parameter.default is parameter.empty]
    of_role = {name for method in role.methods for name in (*method.leads, *method.offers, *role.made_of)}
    if foreign := [key for key in needed if key in OFFERED - of_role]:
        raise MclError(f"a {role.name} is not given {foreign[0]!r}", f"see {PAGE}", path=path, line=line)
    fitting = []
    for method in role.methods:
        leads = [key for key in needed if key not in (*method.offers, *role.made_of)]
        if len(leads) == len(method.leads) and leads == list(parameters)[: len(leads)]:
            fitting.append(method)
    named = [method for method in fitting if method.first and needed[0] == method.first]
    if not (fitting := named or [method for method in fitting if not method.first]):
        wanted = " or ".join(f"({', '.join(method.leads)})" for method in role.methods)
        said = f"{part.short} takes ({', '.join(parameters)}): expected {wanted}"
        more = sorted({name for method in role.methods for name in (*method.offers, *role.made_of)})
        raise MclError(said, f"and only as far as it needs them {', '.join(more)}", path=path, line=line)
    _check_names(parameters, len(fitting[0].leads), {*fitting[0].offers, *role.made_of}, part)
    return fitting[0]


def _check_names(parameters: Mapping[str, inspect.Parameter], leads: int, offered: set[str], part: Part) -> None:
    path, line = part.place
    _check_plain(part, parameters)
    for number, (key, parameter) in enumerate(parameters.items()):
        wrong = parameter.KEYWORD_ONLY if number < leads else parameter.POSITIONAL_ONLY
        if parameter.kind is wrong:
            how = "by its place, not by its name" if number < leads else "by its name, not by its place"
            raise MclError(
                f"{part.short} is given {key!r} {how}", "move the * or / in its arguments", path=path, line=line
            )
        if number >= leads and parameter.default is parameter.empty and key not in offered:
            said = f"the argument {key!r} of {part.short} has no default, and is none of {', '.join(sorted(offered))}"
            raise MclError(said, "give it a default if it is a parameter of your own", path=path, line=line)


def _check_plain(part: Part, parameters: Mapping[str, inspect.Parameter]) -> None:
    path, line = part.place
    if any(p.kind in (p.VAR_KEYWORD, p.VAR_POSITIONAL) for p in parameters.values()):
        said = f"{part.name} takes *args or **kwargs, and a part names its arguments"
        raise MclError(said, f"call it from a function that does: see {PAGE}", path=path, line=line)


def _signature(target: Any) -> inspect.Signature:
    try:
        return inspect.signature(getattr(target, "py_func", target))
    except (TypeError, ValueError) as error:
        raise MclError(
            "the arguments of this part cannot be told", "put it into a function written in Python"
        ) from error


def _installed(role: Role) -> dict[str, Any]:
    return {point.name: point for point in entry_points(group=role.group)}


def _from_module(name: str, role: Role) -> Any:
    try:
        return importlib.import_module(name)
    except Exception as error:
        hint = "is it installed, and spelt like that? A file is named with its .py"
        raise MclError(f"{role.name}: the module {name!r} cannot be loaded: {told(error)}", hint) from error


def module_of(path: Path) -> Any:
    """The module in a file. Raises MclError, with the line, if it cannot be loaded."""
    if not path.is_file():
        raise MclError("there is no such file", "a part of your own is named as FILE.py:NAME", path=path)
    return _executed(path, path.stat().st_mtime_ns)


@cache
def _executed(path: Path, _: int) -> Any:
    """The module in a file, read once as long as the file does not change."""
    name = f"own_part_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:8]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None, "a name that ends in .py"
    assert spec.loader is not None, "a name that ends in .py"
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # before it runs: its dataclasses and compiled functions look for it there
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise MclError(f"it cannot be loaded: {told(error)}", path=path, line=line_of(error, path)) from error
    return module
