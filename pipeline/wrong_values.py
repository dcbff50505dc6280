"""What a value should have been, in the words of this program and not in those of the library that checks it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

_KINDS = {"integer": "a whole number", "number": "a number", "boolean": "true or false", "string": "a text"}
_BOUNDS = {
    "greater_than": "a number above {gt:,g}",
    "greater_than_equal": "a number of at least {ge:,g}",
    "less_than": "a number below {lt:,g}",
    "less_than_equal": "a number of at most {le:,g}",
    "literal_error": "{expected}",
    "finite_number": "a finite number",
    "missing": "a value",
}
_TYPES = {
    "int": "a whole number",
    "float": "a number",
    "bool": "true or false",
    "string": "a text",
    "tuple": "a list in brackets",
    "list": "a list in brackets",
    "dict": "names with values",
    "model": "names with values",
}


def kind_and_range(schema: Mapping[str, Any]) -> str:
    """What values a field takes, by its JSON schema: ``a number above 0``, ``one of kld, duplicates, none``."""
    if "anyOf" in schema:
        return " or ".join("null" if one.get("type") == "null" else kind_and_range(one) for one in schema["anyOf"])
    if "enum" in schema:
        return f"one of {', '.join(map(str, schema['enum']))}"
    if schema.get("type") == "array":
        if "prefixItems" in schema:
            each = kind_and_range(schema["prefixItems"][0]).removeprefix("a number").strip()
            return f"{len(schema['prefixItems'])} numbers in brackets" + (f", each {each}" if each else "")
        return f"a list in brackets, like [{schema['items']['enum'][0]}], of {', '.join(schema['items']['enum'])}"
    kind = _KINDS.get(str(schema.get("type")), "names with values")
    least, most, above = (schema.get(key) for key in ("minimum", "maximum", "exclusiveMinimum"))
    if least is not None and most is not None:
        return f"{kind} from {least:,g} to {most:,.0f}"
    if above is not None:
        return f"{kind} above {above:g}"
    return kind if least is None else f"{kind} of at least {least:g}"


def expectation(error: Mapping[str, Any]) -> str:
    """What pydantic's error says was expected; of a check of our own, what that says."""
    kind, about = str(error["type"]), error.get("ctx", {})
    if kind in _BOUNDS:
        return f"expected {_BOUNDS[kind].format_map(about)}"
    if (of := _TYPES.get(kind.partition("_")[0])) is not None:
        return f"expected {of}"
    return str(error["msg"]).removeprefix("Value error, ").replace("Input should be", "expected")
