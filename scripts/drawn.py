"""Faults of one line, drawn from the package's sources, and the tests nearest to them."""

from __future__ import annotations

import ast
import random
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from scripts.called import Calls

ROOT = Path(__file__).parents[1]
SECONDS = 25.0  # processor time of tests that should notice a fault [s]
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


class Fault(NamedTuple):
    """A file with one wrong line.

    Attributes:
        file: from the root.
        function: that the line is in, with its class; the class, or "", outside of functions.
        assigned: names that the statement gives values to.
        text: of the whole file, without comments.
        line: of the file as it is.
        before: the statement, or its first line.
        after: what stands in its place.
    """

    file: str
    function: str
    assigned: tuple[str, ...]
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
        function = _places(tree)[statement]
        before = ast.unparse(statement).splitlines()
        change(rng)
        after = ast.unparse(ast.fix_missing_locations(statement)).splitlines()
        differ = [k for k, pair in enumerate(zip(before, after, strict=False)) if len({*pair}) > 1]
        if differ:  # else two equal arguments changed places
            at = differ[0]
            line = statement.lineno
            text = ast.unparse(tree) + "\n"
            name = path.relative_to(ROOT).as_posix()
            assigned = _assigned(statement)
            return Fault(
                name, function, assigned, text, line, before[at].strip(), after[at].strip()
            )


def _assigned(statement: ast.stmt) -> tuple[str, ...]:
    names = (node for node in ast.walk(statement) if isinstance(node, ast.Name))
    return tuple({node.id: 0 for node in names if isinstance(node.ctx, ast.Store)})


def _places(tree: ast.Module) -> dict[ast.stmt, str]:
    """The function or class that every statement is in, by the name that Python gives to it."""
    found: dict[ast.stmt, str] = {}
    left: list[tuple[ast.AST, str]] = [(tree, "")]
    while left:
        node, prefix = left.pop()
        if isinstance(node, ast.stmt):
            found[node] = prefix.removesuffix(".").removesuffix(".<locals>")
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found[node] = prefix + node.name
            prefix += (
                f"{node.name}.<locals>." if isinstance(node, ast.FunctionDef) else f"{node.name}."
            )
        left += [(child, prefix) for child in ast.iter_child_nodes(node)]
    return found


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


def nearest(fault: Fault, calls: Calls) -> tuple[str, ...]:
    """Tests that call the function that has a fault; of those that take long, the cheaper ones.

    The tests of its place and name come first, then the cheapest of every file of tests, then the
    second ones. Outside of functions, tests of the functions that read what the statement sets,
    or else of all functions of its class or file.
    """
    called: set[str] = set()
    for function in _affected(fault, calls):
        called.update(calls.functions.get(function, ()))
    source = Path(fault.file).relative_to("nsaid_mj")
    by_file: dict[str, list[str]] = defaultdict(list)
    for test in sorted(called, key=lambda test: calls.seconds[test]):
        by_file[test.partition("::")[0]].append(test)
    ranked = []
    for file, tests in by_file.items():
        beside = (Path("tests") / source.parent).is_relative_to(Path(file).parent)
        named = source.stem.strip("_") in file
        far = 2 - beside - named
        ranked += [
            (far, k if far else 0, calls.seconds[test], test) for k, test in enumerate(tests)
        ]
    chosen: list[str] = []
    paid: set[str] = set()
    spent = 0.0
    for *_, test in sorted(ranked):
        new = set(calls.shared.get(test, ())) - paid
        cost = calls.seconds[test] + sum(calls.fixtures[key] for key in new)
        if not chosen or spent + cost < SECONDS:
            chosen.append(test)
            paid |= new
            spent += cost
    return tuple(chosen)


def _affected(fault: Fault, calls: Calls) -> Iterable[str]:
    """The functions whose callers should notice a fault."""
    inner = fault.file.removeprefix("nsaid_mj/")
    tree = ast.parse(fault.text)
    places = _places(tree)
    functions = {name for node, name in places.items() if isinstance(node, ast.FunctionDef)}
    place = fault.function
    if place not in functions:
        of_class = [f"{inner}:{name}" for name in functions if name.startswith(place)]
        return _readers(fault.assigned) & calls.functions.keys() or of_class
    while f"{inner}:{place}" not in calls.functions and ".<locals>." in place:
        place = place.rpartition(".<locals>.")[0]
    return [f"{inner}:{place}"]


def _readers(names: tuple[str, ...]) -> set[str]:
    """Functions of the package that read any of some names."""
    found: set[str] = set()
    for path in (ROOT / "nsaid_mj").rglob("*.py"):
        tree = _tree(path)
        inner = path.relative_to(ROOT / "nsaid_mj").as_posix()
        for node, place in _places(tree).items():
            if isinstance(node, ast.FunctionDef) and _reads(node, names):
                found.add(f"{inner}:{place}")
    return found


def _reads(function: ast.FunctionDef, names: tuple[str, ...]) -> bool:
    return any(
        (isinstance(node, ast.Name) and node.id in names)
        or (isinstance(node, ast.Attribute) and node.attr in names)
        for node in ast.walk(function)
    )
