"""A small mutation tool: every way to change one thing in a Python file that somebody might get wrong."""

from __future__ import annotations

import ast
import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

OPERATORS: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
}
COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.Gt, ast.LtE),
    ast.Gt: (ast.Lt, ast.GtE),
    ast.LtE: (ast.GtE, ast.Lt),
    ast.GtE: (ast.LtE, ast.Gt),
    ast.Eq: (ast.NotEq,),
}
EXCHANGED = {"cos": "sin", "sin": "cos", "max": "min", "min": "max", "floor": "ceil", "exp": "log"}
LEFT_OUT = {"sqrt", "wrap", "abs", "exp"}
ANGLES = {"cos", "sin"}


@dataclass(frozen=True)
class Mutant:
    """A file with one change, of a kind: sign, operator, comparison, number, index, order, call or unit."""

    kind: str
    line: int
    what: str
    source: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.what}"


def mutants(source: str, function: str) -> list[Mutant]:
    """Every file that differs from ``source`` in one thing, anywhere below its top level."""
    tree = ast.parse(source)
    found = []
    for place, node in enumerate(ast.walk(tree)):
        for kind, what, changed in _changes(node):
            mutated = copy.deepcopy(tree)
            _replace(mutated, place, changed)
            text = ast.unparse(ast.fix_missing_locations(mutated))
            found.append(Mutant(kind, getattr(node, "lineno", 0), what, text))
    unique = {mutant.source: mutant for mutant in found if mutant.source != ast.unparse(tree)}
    return [mutant for mutant in unique.values() if f"def {function}(" in mutant.source]


def _replace(tree: ast.AST, place: int, changed: ast.AST) -> None:
    """Put ``changed`` where the node of this number is."""
    wanted = next(node for k, node in enumerate(ast.walk(tree)) if k == place)
    for parent in ast.walk(tree):
        for name, value in ast.iter_fields(parent):
            if value is wanted:
                setattr(parent, name, changed)
                return
            if isinstance(value, list) and any(item is wanted for item in value):
                value[[item is wanted for item in value].index(True)] = changed
                return


def _changes(node: ast.AST) -> Iterator[tuple[str, str, Any]]:
    was = ast.unparse(node) if isinstance(node, ast.expr | ast.stmt) else ""

    def told(kind: str, changed: ast.AST) -> tuple[str, str, Any]:
        return kind, f"{was}  ->  {ast.unparse(ast.fix_missing_locations(copy.deepcopy(changed)))}", changed

    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        yield told("operator", ast.BinOp(node.left, OPERATORS[type(node.op)](), node.right))
        if isinstance(node.op, ast.Sub | ast.Div):
            yield told("order", ast.BinOp(node.right, node.op, node.left))
        if isinstance(node.op, ast.Pow):
            yield told("operator", node.left)
    if isinstance(node, ast.AugAssign) and type(node.op) in OPERATORS:
        yield told("operator", ast.AugAssign(node.target, OPERATORS[type(node.op)](), node.value))
        yield told("operator", ast.Assign([node.target], node.value))
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield told("sign", node.operand)
    if isinstance(node, ast.Compare) and len(node.ops) == 1:
        for other in COMPARISONS.get(type(node.ops[0]), ()):
            yield told("comparison", ast.Compare(node.left, [other()], node.comparators))
    if isinstance(node, ast.Constant) and isinstance(node.value, int | float) and not isinstance(node.value, bool):
        yield told("number", ast.Constant(node.value + 1))
        if node.value not in (0, 1):
            yield told("number", ast.Constant(1))
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Constant) and isinstance(node.slice.value, int):
        yield told("index", ast.Subscript(node.value, ast.Constant((node.slice.value + 1) % 2), node.ctx))
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Name):
        off = ast.BinOp(node.slice, ast.Sub(), ast.Constant(1))
        yield told("index", ast.Subscript(node.value, off, node.ctx))
    if isinstance(node, ast.Subscript) and isinstance(node.slice, ast.Tuple) and len(node.slice.elts) == 2:
        yield told("index", ast.Subscript(node.value, ast.Tuple(node.slice.elts[::-1], ast.Load()), node.ctx))
    if isinstance(node, ast.Call):
        yield from _changed_calls(node, told)
    if isinstance(node, ast.Return) and isinstance(node.value, ast.BinOp):
        yield told("sign", ast.Return(ast.UnaryOp(ast.USub(), node.value)))
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Tuple) and isinstance(node.value, ast.Name):
        names = node.targets[0].elts
        yield told("order", ast.Assign([ast.Tuple([names[1], names[0], *names[2:]], ast.Store())], node.value))
        yield told("order", ast.Assign([ast.Tuple([*names[:-2], names[-1], names[-2]], ast.Store())], node.value))


def _changed_calls(node: ast.Call, told: Any) -> Iterator[tuple[str, str, Any]]:
    name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
    if name in EXCHANGED:
        other: ast.expr = ast.Name(EXCHANGED[name], ast.Load())
        if isinstance(node.func, ast.Attribute):
            other = ast.Attribute(node.func.value, EXCHANGED[name], ast.Load())
        yield told("call", ast.Call(other, node.args, node.keywords))
    if name in LEFT_OUT and len(node.args) == 1:
        yield told("call", node.args[0])
    if name in ANGLES:
        yield told("unit", ast.Call(node.func, [ast.BinOp(node.args[0], ast.Mult(), ast.Constant(0.0174533))], []))
    if len(node.args) == 2 and name not in ("hypot", "zip"):
        yield told("order", ast.Call(node.func, node.args[::-1], node.keywords))
