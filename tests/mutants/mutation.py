"""Small changes of a source file, one at a time: each is a fault that some test should notice.

What is not computed is left as it is: annotations, decorators, docstrings, the words of messages, and
`assert` and `strict=`, which are checks of the source on itself.
"""

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise, product
from os.path import commonprefix
from typing import Any

# What stands in the place of an operator, or of a function's name.
OPERATORS: dict[type[ast.AST], tuple[Any, ...]] = {
    ast.Add: (ast.Sub,), ast.Sub: (ast.Add,), ast.Mult: (ast.Div,), ast.Div: (ast.Mult,),
    ast.FloorDiv: (ast.Mult,), ast.Mod: (ast.Mult,), ast.Pow: (ast.Mult,),
    ast.BitAnd: (ast.BitOr,), ast.BitOr: (ast.BitAnd,), ast.And: (ast.Or,), ast.Or: (ast.And,),
    ast.Lt: (ast.LtE, ast.GtE), ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE), ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,), ast.NotEq: (ast.Eq,), ast.Is: (ast.IsNot,), ast.IsNot: (ast.Is,),
    ast.In: (ast.NotIn,), ast.NotIn: (ast.In,),
}  # fmt: skip
PAIRS = ["min max", "minimum maximum", "argmin argmax", "any all", "floor ceil"]
OPPOSITES = {a: b for pair in PAIRS for a, b in (pair.split(), pair.split()[::-1])}
SYMMETRIC = {"min", "max", "minimum", "maximum"}  # their arguments may be swapped
UNTOUCHED = (ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom)
DECLARED = {"annotation", "returns", "decorator_list", "bases"}
SCOPES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
SHOWN = 80  # characters of a long line on both sides of its change


@dataclass(frozen=True)
class Mutant:
    """One change of one source file.

    Attributes:
      path: of the file, as it was given.
      where: name of the function or class that is changed, with those around it; "" outside of all.
      line: of the statement or expression that is changed.
      before, after: the statement that is changed, on one line; of a long one the part about the change.
      source: the whole changed file, without comments.
    """

    path: str
    where: str
    line: int
    before: str
    after: str
    source: str = field(repr=False)

    @property
    def key(self) -> tuple[str, str, str, str]:
        """Names the change wherever it stands in the file."""
        return self.path, self.where, self.before, self.after

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.where}\n    - {self.before}\n    + {self.after}"


def mutants_of(path: str, source: str) -> list[Mutant]:
    """All mutants of a file, in the order of its lines, each once."""
    tree, found = ast.parse(source), dict[str, Mutant]()
    sound = ast.unparse(tree)
    spare = {id(part) for node in ast.walk(tree) for part in _left_out(node)}
    for holder, key, part, where in _computed(tree, ""):
        node = holder[key]
        others = [*_in_its_part(node, part), *_in_itself(node)]
        for other in [ast.Pass(), *others] if id(node) in spare else others:
            holder[key] = other
            changed = ast.unparse(tree)
            if changed != sound:
                said = _differing(sound, changed)
                found.setdefault(changed, Mutant(path, where, node.lineno, *said, changed))
        holder[key] = node
    return sorted(found.values(), key=lambda mutant: mutant.line)


def _computed(parent: ast.AST, where: str) -> Iterator[tuple[Any, Any, str, str]]:
    """All that is computed: what holds it, its key there, which part it is, and the scope around it."""
    for part, value in ast.iter_fields(parent):
        inside = enumerate(value) if isinstance(value, list) else [(part, value)]
        for key, node in inside if part not in DECLARED else ():
            if isinstance(node, ast.AST) and not _is_check(node):
                scope = f"{where}.{node.name}".strip(".") if isinstance(node, SCOPES) else where
                holder = value if isinstance(value, list) else vars(parent)
                yield holder, key, "result" if isinstance(parent, ast.Return) else part, scope
                if not isinstance(node, UNTOUCHED):
                    yield from _computed(node, scope)


def _is_check(node: ast.AST) -> bool:
    return isinstance(node, ast.keyword) and node.arg == "strict"


def _in_its_part(node: ast.AST, part: str) -> Iterator[ast.AST]:
    """A condition the other way round, unless its operator is changed; no result; a slice's end one off."""
    if part in {"test", "ifs"} and not isinstance(node, ast.Compare | ast.UnaryOp | ast.BoolOp):
        yield ast.UnaryOp(ast.Not(), node)
    if part == "result":
        yield ast.Constant(None)
    if part in {"lower", "upper"} and not isinstance(node, ast.Constant):
        yield ast.BinOp(node, ast.Add(), ast.Constant(1))


def _in_itself(node: ast.AST) -> Iterator[ast.AST]:
    """Another operator; only what is on its left, or without its sign; another number or call."""
    yield from _other_operators(node)
    match node:
        case ast.BinOp(left, ast.Mult() | ast.Div() | ast.Pow() | ast.Add() | ast.Sub()):
            yield left
        case ast.UnaryOp(_, operand):
            yield operand
        case ast.Constant(value):
            yield from _other_values(value)
        case ast.Call():
            yield from _other_calls(node)


def _other_operators(node: ast.AST) -> Iterator[ast.AST]:
    match node:
        case ast.BinOp(left, op, right):
            yield from (ast.BinOp(left, other, right) for other in _instead_of(op))
        case ast.AugAssign(target, op, value):
            yield from (ast.AugAssign(target, other, value) for other in _instead_of(op))
        case ast.BoolOp(op, values):
            for other, i in product(_instead_of(op), range(len(values) - 1)):
                two = ast.BoolOp(other, values[i : i + 2])
                yield ast.BoolOp(op, [*values[:i], two, *values[i + 2 :]]) if values[2:] else two
        case ast.Compare(left, ops, right):
            for i, op in enumerate(ops):
                for other in _instead_of(op):
                    yield ast.Compare(left, [*ops[:i], other, *ops[i + 1 :]], right)


def _instead_of(op: ast.AST) -> list[Any]:
    return [other() for other in OPERATORS.get(type(op), ())]


def _other_values(value: object) -> Iterator[ast.AST]:
    """A switch the other way, a number one off, or a float twice as large; 0.0 and 1.0 are exchanged."""
    others: tuple[object, ...] = ()
    if isinstance(value, bool):
        others = (not value,)
    elif isinstance(value, int):
        others = (value + 1, value - 1)
    elif isinstance(value, float):
        others = ({0.0: 1.0, 1.0: 0.0}.get(value, 2 * value),)
    return (ast.parse(repr(other), mode="eval").body for other in others)


def _other_calls(call: ast.Call) -> Iterator[ast.AST]:
    """The opposite function; two neighbouring arguments of one form exchanged; without a named argument."""
    func, args, named = call.func, call.args, call.keywords
    called = func.id if isinstance(func, ast.Name) else getattr(func, "attr", "")
    if called in OPPOSITES:
        name = OPPOSITES[called]
        new = ast.Name(name) if isinstance(func, ast.Name) else ast.Attribute(func.value, name)
        yield ast.Call(new, args, named)
    for i, (one, other) in enumerate(pairwise(args)):
        if type(one) is type(other) is not ast.Starred and called not in SYMMETRIC:
            yield ast.Call(func, [*args[:i], other, one, *args[i + 2 :]], named)
    for i, keyword in enumerate(named):
        if keyword.arg is not None and not _is_check(keyword):
            yield ast.Call(func, args, named[:i] + named[i + 1 :])


def _left_out(function: ast.AST) -> Iterator[ast.AST]:
    """Statements that a function may lack: none that gives a name its first value."""
    if not isinstance(function, ast.FunctionDef):
        return
    arguments = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    first = {argument.arg: 0 for argument in arguments}
    for node in ast.walk(function):
        for name in _stored(node):
            first[name] = min(first.get(name, node.lineno), node.lineno)  # type: ignore[attr-defined]
    for node in ast.walk(function):
        if isinstance(node, ast.Raise | ast.AugAssign | ast.Continue | ast.Break) or _is_call(node):
            yield node
        elif isinstance(node, ast.Assign):
            names = [name for part in ast.walk(node) for name in _stored(part)]
            if all(first[name] < node.lineno for name in names):
                yield node


def _stored(node: ast.AST) -> list[str]:
    return [node.id] if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else []


def _is_call(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)


def _differing(sound: str, changed: str) -> tuple[str, str]:
    """The statement that differs, before and after; of a long one the part about the difference."""
    lines = zip(sound.splitlines(), changed.splitlines(), strict=False)
    one, other = next((a.strip(), b.strip()) for a, b in lines if a != b)
    ends = (one, other), (one[::-1], other[::-1])
    head, tail = (max(len(commonprefix(two)) - SHOWN, 0) for two in ends)  # noqa: RUF071
    return one[head : len(one) - tail], other[head : len(other) - tail]
