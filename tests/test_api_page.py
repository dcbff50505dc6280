"""docs/api.md lists what `import pipeline` offers, with its signatures; its examples give what it says."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path

import matplotlib
import pytest

import pipeline

ROOT = Path(__file__).resolve().parents[1]
PAGE = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
ENTRIES = {
    name: (signature, text, example)
    for name, signature, text, example in re.findall(
        r"^### (\w+)\n\n```python\n(.*?)```\n\n(.*?)\n\n```pycon\n(.*?)```$", PAGE, re.M | re.S
    )
}
WITHOUT = {
    "Config": "Config(**values: Any)",
    "Sink": "class Sink(Protocol):\n    def log(self, step: Step) -> None: ...",
}
"""What has no signature of its own: a model of pydantic, whose parameters are another page, and a protocol."""


def annotation(value: object) -> str:
    return value if isinstance(value, str) else str(getattr(value, "__name__", value))


def parameter(one: inspect.Parameter) -> str:
    stars = {inspect.Parameter.VAR_POSITIONAL: "*", inspect.Parameter.VAR_KEYWORD: "**"}.get(one.kind, "")
    typed = f"{stars}{one.name}: {annotation(one.annotation)}"
    if one.default is inspect.Parameter.empty:
        return typed
    default = repr(one.default)
    return f"{typed} = {'...' if default.startswith('<') else default}"


def signature(name: str) -> str:
    """As Python has it, a parameter a line if it is long."""
    if name in WITHOUT:
        return WITHOUT[name]
    offered = getattr(pipeline, name)
    found = inspect.signature(offered)
    parameters: list[str] = []
    for one in found.parameters.values():
        if one.kind is inspect.Parameter.KEYWORD_ONLY and "*" not in parameters:
            parameters.append("*")
        parameters.append(parameter(one))
    returned = "" if inspect.isclass(offered) else f" -> {annotation(found.return_annotation)}"
    line = f"{name}({', '.join(parameters)}){returned}"
    return line if len(line) <= 100 else "\n".join([f"{name}(", *(f"    {one}," for one in parameters), f"){returned}"])


def test_the_page_lists_what_is_offered() -> None:
    assert sorted(ENTRIES) == sorted(pipeline.__all__)
    assert re.findall(r"^### (\w+)$", PAGE, re.M) == list(ENTRIES), "an entry is not as the others are"


@pytest.mark.parametrize("name", sorted(pipeline.__all__))
def test_signatures_are_as_they_are(name: str) -> None:
    assert ENTRIES[name][0].strip() == signature(name)


@pytest.mark.parametrize("name", sorted(pipeline.__all__))
def test_every_entry_says_something_and_uses_what_it_is_about(name: str) -> None:
    _, text, example = ENTRIES[name]
    assert len(text) > 20
    assert ">>> " in example
    assert inspect.getdoc(getattr(pipeline, name))


def test_examples_give_what_the_page_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All of them, one after the other, as somebody would type them who reads the page."""
    (tmp_path / "data").symlink_to(ROOT / "data")
    monkeypatch.chdir(tmp_path)
    matplotlib.use("Agg")
    text = "\n\n".join(example for _, _, example in ENTRIES.values())
    test = doctest.DocTestParser().get_doctest(text, {}, "docs/api.md", "docs/api.md", 0)
    said: list[str] = []
    runner = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS)
    runner.run(test, out=said.append)
    assert runner.summarize(verbose=False).failed == 0, "".join(said)
    assert test.examples
