"""Faults of one line, drawn from the package's sources, and the tests nearest to them."""

from __future__ import annotations

import ast
import random
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
NEAREST = 3  # files of tests that should notice a fault
_OPPOSITE: dict[type, type] = {
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.And: ast.Or,
    ast.Or: ast.And,
}
_LIKE = {
    name: other
    for pair in (("min", "max"), ("any", "all"), ("sin", "cos"), ("argmin", "argmax"))
    for name, other in (pair, pair[::-1])
} | {"minimum": "maximum", "maximum": "minimum", "first": "last", "last": "first"}


_IMPORTS = re.compile(r"from (\.+)([\w.]*) import (\([^)]*\)|[^\n]*)")


class Fault(NamedTuple):
    """A file with one wrong line.

    Attributes:
        file: from the root.
        text: of the whole file, without comments.
        line: of the file as it is.
        before: the statement, or its first line.
        after: what stands in its place.
    """

    file: str
    text: str
    line: int
    before: str
    after: str


def rooms(package: Path = ROOT / "nsaid_mj") -> dict[str, list[Path]]:
    """The sources of every folder of the package that has any, by `house/room`."""
    found: dict[str, list[Path]] = defaultdict(list)
    for path in sorted(package.rglob("*.py")):
        inner = path.relative_to(package).parent.as_posix()
        if inner != "." and path.name != "__init__.py" and not inner.startswith("_"):
            found[inner].append(path)
    return dict(found)


def drawn(files: list[Path], rng: random.Random) -> Fault:
    """A fault in one of some files, the longer ones more often.

    Raises:
        IndexError: no file has a line to change.
    """
    places = [(path, place) for path in files for place in range(len(_changes(_tree(path))))]
    while True:
        path, place = rng.choice(places)
        tree = _tree(path)
        statement, change = _changes(tree)[place]
        before = ast.unparse(statement).splitlines()
        change(rng)
        after = ast.unparse(ast.fix_missing_locations(statement)).splitlines()
        differ = [k for k, pair in enumerate(zip(before, after, strict=False)) if len({*pair}) > 1]
        if differ:  # else two equal arguments changed places
            at = differ[0]
            line = statement.lineno
            text = ast.unparse(tree) + "\n"
            name = path.relative_to(ROOT).as_posix()
            return Fault(name, text, line, before[at].strip(), after[at].strip())


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _changes(tree: ast.Module) -> list[tuple[ast.stmt, Callable[[random.Random], None]]]:
    """Every statement of a module with a function that makes it wrong in one place."""
    siblings = _siblings(tree)
    skipped = ast.Import | ast.ImportFrom | ast.ClassDef
    return [
        (statement, change)
        for statement in ast.walk(tree)
        if isinstance(statement, ast.stmt) and not isinstance(statement, skipped)
        for node in _own_parts(statement)
        for change in _of(node, siblings)
    ]


def _own_parts(statement: ast.stmt) -> Iterator[ast.AST]:
    """The parts of a statement without those of statements in it, and without annotations."""
    skipped = {"annotation", "returns", "decorator_list"}
    left: list[ast.AST] = [statement]
    while left:
        node = left.pop()
        yield node
        for name, value in ast.iter_fields(node):
            values = value if isinstance(value, list) else [value]
            if name not in skipped:
                left += [v for v in values if isinstance(v, ast.AST) and not _apart(v)]


def _apart(node: ast.AST) -> bool:
    """Whether a part is a statement of its own, or changes only how a text looks."""
    looks = isinstance(node, ast.keyword) and node.arg in {"stacklevel", "significant", "indent"}
    return looks or isinstance(node, ast.stmt | ast.excepthandler | ast.match_case)


def _siblings(tree: ast.Module) -> dict[str, list[str]]:
    """The values that a module reads of each thing, such as the streams of `self.seeds`."""
    found: dict[str, set[str]] = defaultdict(set)
    called = {node.func for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for node in ast.walk(tree):
        read = isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load)
        if read and node not in called:
            found[ast.unparse(node.value)].add(node.attr)
    modules = {"np", "re", "os", "math", "json", "shutil", "sys", "time", "ast", "pin", "mujoco"}
    return {name: sorted(own) for name, own in found.items() if name not in modules}


def _of(node: ast.AST, siblings: dict[str, list[str]]) -> Iterator[Callable[[random.Random], None]]:
    """Functions that make one part wrong in place."""
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        yield lambda rng: setattr(node, "value", _other_number(node.value, rng))
    elif isinstance(node, ast.Compare) and type(node.ops[0]) in _OPPOSITE:
        yield lambda _: node.ops.__setitem__(0, _OPPOSITE[type(node.ops[0])]())
    elif isinstance(node, ast.BinOp | ast.BoolOp | ast.AugAssign) and type(node.op) in _OPPOSITE:
        yield lambda _: setattr(node, "op", _OPPOSITE[type(node.op)]())
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield lambda _: setattr(node, "op", ast.UAdd())
    elif isinstance(node, ast.If | ast.IfExp):
        yield lambda _: setattr(node, "test", ast.UnaryOp(ast.Not(), node.test))
    elif isinstance(node, ast.Name) and node.id in _LIKE:
        yield lambda _: setattr(node, "id", _LIKE[node.id])
    elif isinstance(node, ast.Attribute) and node.attr in _LIKE:
        yield lambda _: setattr(node, "attr", _LIKE[node.attr])
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
        own = siblings.get(ast.unparse(node.value), [])
        others = [name for name in own if name != node.attr]
        if others and node.attr in own:
            yield lambda rng: setattr(node, "attr", rng.choice(others))
    elif isinstance(node, ast.Call) and ast.unparse(node.func) != "isinstance":
        names = [k for k, a in enumerate(node.args) if isinstance(a, ast.Name | ast.Attribute)]
        if len(names) > 1:
            yield lambda rng: _swap(node.args, *sorted(rng.sample(names, 2)))


def _swap(values: list[ast.expr], i: int, j: int) -> None:
    values[i], values[j] = values[j], values[i]


def _other_number(value: float, rng: random.Random) -> float:
    """Twice, half or one more; an integer remains one."""
    if isinstance(value, int):
        return rng.choice([value + 1, 2 * value if value > 1 else 1 - value, value // 2 + 1])
    return rng.choice([2 * value, value / 2]) if value else 1.0


def nearest(file: str) -> tuple[str, ...]:
    """The files of tests that import a module, those that mirror its place and name first.

    Of a module that no test imports, those of the modules that import it, or of the command line.
    """
    tests = {path: path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("test_*.py")}
    sources = {
        path.relative_to(ROOT).as_posix(): path.read_text(encoding="utf-8")
        for path in (ROOT / "nsaid_mj").rglob("*.py")
    }
    asked = {file}
    left = [file]
    while left:
        found = _ranked(left, tests)
        if found:
            return tuple(path.relative_to(ROOT).as_posix() for path in found[:NEAREST])
        users = {
            name
            for one in left
            for name, text in sources.items()
            if name not in asked and one in _imports(name, text)
        }
        asked |= users
        left = sorted(users)
    return ("tests/cli/test_cli.py", "tests/cli/test_exit_codes.py")


def _ranked(files: list[str], tests: dict[Path, str]) -> list[Path]:
    """The tests that import any of some modules, or mirror them; first those of its place, name."""
    ranked = []
    for path, text in tests.items():
        rank = 0
        for file in files:
            source = Path(file)
            mirrored = ROOT / "tests" / source.relative_to("nsaid_mj").parent
            close = mirrored.is_relative_to(path.parent)
            named = source.stem.strip("_") in path.stem
            if (close and named) or _from_outside(file).search(text):
                rank = max(rank, 1 + close + 2 * named)
        if rank:
            ranked.append((-rank, path))
    return [path for _, path in sorted(ranked)]


def _from_outside(file: str) -> re.Pattern[str]:
    """How a test imports a module."""
    parent, _, stem = file.removesuffix(".py").replace("/", ".").rpartition(".")
    whole = re.escape(f"{parent}.{stem}")
    return re.compile(rf"{whole}\b|from {re.escape(parent)} import (\([^)]*|.*)\b{stem}\b")


def _imports(name: str, text: str) -> set[str]:
    """The files that a file of the package imports relative to itself, as far as they exist."""
    found: set[str] = set()
    for dots, module, names in _IMPORTS.findall(text):
        base = Path(name).parents[len(dots) - 1].joinpath(*module.split("."))
        parts = [part.split(" as ")[0].strip() for part in names.strip("()").split(",")]
        found |= {f"{base.as_posix()}.py", *(f"{base.as_posix()}/{part}.py" for part in parts)}
    return found
