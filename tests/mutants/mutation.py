"""Small changes of a source file, one at a time: each is a fault that some test should notice.

What is not computed is left as it is: annotations, decorators, docstrings, the words of messages, and
`assert` and `strict=`, which are checks of the source on itself.
"""

import ast
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

# What stands in the place of an operator, or of a function's name.
OPERATORS: dict[type[ast.AST], tuple[str, tuple[str, ...]]] = {
    ast.Add: ("+", ("-",)),
    ast.Sub: ("-", ("+",)),
    ast.Mult: ("*", ("/",)),
    ast.Div: ("/", ("*",)),
    ast.FloorDiv: ("//", ("*",)),
    ast.Mod: ("%", ("*",)),
    ast.Pow: ("**", ("*",)),
    ast.BitAnd: ("&", ("|",)),
    ast.BitOr: ("|", ("&",)),
    ast.And: ("and", ("or",)),
    ast.Or: ("or", ("and",)),
    ast.Lt: ("<", ("<=", ">=")),
    ast.LtE: ("<=", ("<", ">")),
    ast.Gt: (">", (">=", "<=")),
    ast.GtE: (">=", (">", "<")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
OPPOSITES = {
    a: b
    for one, other in (
        ("min", "max"),
        ("minimum", "maximum"),
        ("argmin", "argmax"),
        ("any", "all"),
        ("floor", "ceil"),
    )
    for a, b in ((one, other), (other, one))
}
SYMMETRIC = {"min", "max", "minimum", "maximum"}  # their arguments may be swapped
UNTOUCHED = (ast.JoinedStr, ast.Assert, ast.Import, ast.ImportFrom)
SCOPES = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
COMPOSED = (ast.BinOp, ast.BoolOp, ast.Compare, ast.IfExp, ast.Lambda, ast.UnaryOp)


@dataclass(frozen=True)
class Mutant:
    """One change of one source file.

    Attributes:
      path: of the file, as it was given.
      where: name of the function or class that is changed, with those around it; "" outside of all.
      line: first line that is changed.
      before, after: the lines that are changed, on one line each.
      source: the whole changed file.
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


Change = tuple[int, int, str]  # first byte, the one after the last, and what stands there instead


def mutants_of(path: str, source: str) -> list[Mutant]:
    """All mutants of a file, in the order of its lines, each once."""
    text, sound = Text(source), ast.parse(source)
    said, found = ast.dump(sound), dict[str, Mutant]()
    for node, where in _computed(sound, ""):
        for first, end, new in _changes(node, text):
            changed = text.with_change(first, end, new)
            if changed in found or _said(changed) in (None, said):
                continue
            line, last = text.line_of(first), text.line_of(end)
            gone = last - line - new.count("\n")
            before = _one_line(source, line, last)
            after = _one_line(changed, line, last - gone)
            found[changed] = Mutant(path, where, line, before, after, changed)
    return sorted(found.values(), key=lambda mutant: mutant.line)


class Text:
    """A source whose places are counted in bytes, as `ast` does."""

    def __init__(self, source: str) -> None:
        self._bytes = source.encode()
        self._lines = [0]
        for line in self._bytes.splitlines(keepends=True):
            self._lines.append(self._lines[-1] + len(line))

    def begin(self, node: ast.AST) -> int:
        return self._lines[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]

    def end(self, node: ast.AST) -> int:
        return self._lines[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]

    def of(self, node: ast.AST) -> str:
        """As written; in brackets where it would not hold together without."""
        words = self.between(self.begin(node), self.end(node))
        return f"({words})" if isinstance(node, COMPOSED) else words

    def between(self, first: int, end: int) -> str:
        return self._bytes[first:end].decode()

    def find(self, sign: str, first: int, end: int) -> int:
        return self._bytes.index(sign.encode(), first, end)

    def with_change(self, first: int, end: int, new: str) -> str:
        return (self._bytes[:first] + new.encode() + self._bytes[end:]).decode()

    def line_of(self, place: int) -> int:
        return self._bytes.count(b"\n", 0, place) + 1


def _computed(node: ast.AST, where: str) -> Iterator[tuple[ast.AST, str]]:
    """All that is computed, with the scope that it is in."""
    if isinstance(node, UNTOUCHED) or _is_check(node):
        return
    if isinstance(node, SCOPES):
        where = f"{where}.{node.name}".strip(".")
    yield node, where
    for name, value in ast.iter_fields(node):
        if name not in {"annotation", "returns", "decorator_list", "bases"}:
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from _computed(child, where)


def _is_check(node: ast.AST) -> bool:
    return isinstance(node, ast.keyword) and node.arg == "strict"


def _changes(node: ast.AST, text: Text) -> Iterator[Change]:
    for kinds, changes in CHANGES:
        if isinstance(node, kinds):
            yield from changes(node, text)


def _of_operation(node: ast.BinOp, text: Text) -> Iterator[Change]:
    """Another operator; only what is on its left."""
    yield from _of_operator(node.op, node.left, node.right, text)
    if isinstance(node.op, ast.Mult | ast.Div | ast.Pow | ast.Add | ast.Sub):
        yield _replaced(node, text.of(node.left), text)


def _of_assignment(node: ast.AugAssign, text: Text) -> Iterator[Change]:
    yield from _of_operator(node.op, node.target, node.value, text)


def _of_condition(node: ast.BoolOp, text: Text) -> Iterator[Change]:
    for left, right in pairwise(node.values):
        yield from _of_operator(node.op, left, right, text)


def _of_comparison(node: ast.Compare, text: Text) -> Iterator[Change]:
    for op, (left, right) in zip(node.ops, pairwise([node.left, *node.comparators]), strict=True):
        yield from _of_operator(op, left, right, text)


def _of_operator(op: ast.AST, left: ast.AST, right: ast.AST, text: Text) -> Iterator[Change]:
    sign, others = OPERATORS.get(type(op), ("", ()))
    place = text.find(sign, text.end(left), text.begin(right))
    yield from ((place, place + len(sign), other) for other in others)


def _of_sign(node: ast.UnaryOp, text: Text) -> Iterator[Change]:
    """Without its minus, `not` or `~`."""
    yield _replaced(node, text.of(node.operand), text)


def _of_constant(node: ast.Constant, text: Text) -> Iterator[Change]:
    """A switch the other way, a number one off, or a float twice as large; 0.0 and 1.0 are exchanged."""
    value, others = node.value, list[str]()
    if isinstance(value, bool):
        others = [str(not value)]
    elif isinstance(value, int):
        others = [str(value + 1), f"({value - 1})" if value < 1 else str(value - 1)]
    elif isinstance(value, float):
        others = [{0.0: "1.0", 1.0: "0.0"}.get(value, repr(2 * value))]
    yield from (_replaced(node, other, text) for other in others)


def _of_slice(node: ast.Slice, text: Text) -> Iterator[Change]:
    """One more, where an end is not a number, which is changed by itself."""
    for end in (node.lower, node.upper):
        if end is not None and not isinstance(end, ast.Constant):
            yield _replaced(end, f"{text.of(end)} + 1", text)


def _of_name(node: ast.Call, text: Text) -> Iterator[Change]:
    """The opposite function."""
    if (called := _called(node)) in OPPOSITES:
        end = text.end(node.func)
        yield end - len(called), end, OPPOSITES[called]


def _of_order(node: ast.Call, text: Text) -> Iterator[Change]:
    """Two neighbouring arguments of one form the other way round."""
    for one, other in pairwise(node.args):
        if type(one) is type(other) and not isinstance(one, ast.Starred):
            first, end = text.begin(one), text.end(other)
            between = text.between(text.end(one), text.begin(other))
            a, b = text.between(first, text.end(one)), text.between(text.begin(other), end)
            if _called(node) not in SYMMETRIC:
                yield first, end, f"{b}{between}{a}"


def _of_keywords(node: ast.Call, text: Text) -> Iterator[Change]:
    """Without a named argument."""
    for keyword in node.keywords:
        if keyword.arg is not None and not _is_check(keyword):
            begin, end = text.begin(keyword), text.end(keyword)
            before = [text.end(each) for each in (*node.args, *node.keywords)]
            before = [each for each in before if each < begin]
            comma = not before and text.between(end, end + 1) == ","
            yield max(before, default=begin), end + comma, ""


def _called(node: ast.Call) -> str:
    return node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")


def _of_branch(node: ast.If | ast.IfExp | ast.While, text: Text) -> Iterator[Change]:
    yield from _negated(node.test, text)


def _of_filter(node: ast.comprehension, text: Text) -> Iterator[Change]:
    for test in node.ifs:
        yield from _negated(test, text)


def _negated(test: ast.AST, text: Text) -> Iterator[Change]:
    """The other way round, if it has no operator of its own that is changed."""
    if not isinstance(test, ast.Compare | ast.UnaryOp | ast.BoolOp):
        yield _replaced(test, f"not {text.of(test)}", text)


def _of_return(node: ast.Return, text: Text) -> Iterator[Change]:
    if node.value is not None and ast.unparse(node.value) != "None":
        yield _replaced(node.value, "None", text)


def _of_function(function: ast.FunctionDef, text: Text) -> Iterator[Change]:
    """Without one of its statements, but not one that gives a name its first value."""
    arguments = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    first = {argument.arg: 0 for argument in arguments}
    for node in ast.walk(function):
        for name in _stored(node):
            first[name] = min(first.get(name, node.lineno), node.lineno)  # type: ignore[attr-defined]
    for node in ast.walk(function):
        if isinstance(node, ast.Raise | ast.AugAssign | ast.Continue | ast.Break) or _is_call(node):
            yield _replaced(node, "pass", text)
        elif isinstance(node, ast.Assign):
            names = [name for part in ast.walk(node) for name in _stored(part)]
            if all(first[name] < node.lineno for name in names):
                yield _replaced(node, "pass", text)


def _stored(node: ast.AST) -> list[str]:
    return [node.id] if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store) else []


def _is_call(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)


def _replaced(node: ast.AST, new: str, text: Text) -> Change:
    return text.begin(node), text.end(node), new


def _said(source: str) -> str | None:
    """What a source says, however it is laid out; None if it is not Python."""
    try:
        return ast.dump(ast.parse(source))
    except SyntaxError:
        return None


def _one_line(source: str, first: int, last: int) -> str:
    return " ".join(line.strip() for line in source.splitlines()[first - 1 : last])


CHANGES: tuple[tuple[Any, Callable[[Any, Text], Iterator[Change]]], ...] = (
    (ast.BinOp, _of_operation),
    (ast.AugAssign, _of_assignment),
    (ast.BoolOp, _of_condition),
    (ast.Compare, _of_comparison),
    (ast.UnaryOp, _of_sign),
    (ast.Constant, _of_constant),
    (ast.Slice, _of_slice),
    (ast.Call, _of_name),
    (ast.Call, _of_order),
    (ast.Call, _of_keywords),
    (ast.If | ast.IfExp | ast.While, _of_branch),
    (ast.comprehension, _of_filter),
    (ast.Return, _of_return),
    (ast.FunctionDef, _of_function),
)
