"""Measures how much of one house another must know: doors, arrows, cycles, and the text itself.

    python -m scripts.houses                 the table of this checkout
    python -m scripts.houses FOLDER          that of another one's package
    python -m scripts.houses --names HOUSE   the names that others take from a house, and who

A *house* is a folder (or a file) directly in the package. Its *door* is the set of its names that
other houses import; a module imported whole counts as the names that are read from it. Imports
inside functions and for types alone count. Everything is read from the syntax trees; nothing of the
package is imported.
"""

from __future__ import annotations

import argparse
import ast
import io
import tokenize
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "nsaid_mj"
STREET = ("base", "core", "watch", "robots", "report", "lab", "clinic", "plans", "cli")
"""The houses in their order: each imports only from the doors of those before it."""
_LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
"""Tokens that are no code."""


@dataclass(frozen=True)
class Taken:
    """A name that a module takes from another.

    Attributes:
        by: the module that imports.
        module: the module that the import names, or that a door leads to.
        name: the name; "" for a module imported whole, of which nothing is read.
        through: whether it is imported from the other house's door.
    """

    by: str
    module: str
    name: str
    through: bool


class Street:
    """The modules of a package and what they import from one another.

    `package` is the package's folder. Modules are named relative to it, with dots; a package's own
    name stands for its `__init__.py`.
    """

    def __init__(self, package: Path = PACKAGE):
        self.package = package
        self.files: dict[str, Path] = {}
        for path in sorted(package.rglob("*.py")):
            name = ".".join(path.relative_to(package).with_suffix("").parts)
            self.files[name.removesuffix("__init__").removesuffix(".")] = path
        self.files.pop("", None)  # the package's own door, for users

    @cached_property
    def trees(self) -> dict[str, ast.Module]:
        """The syntax tree of every module."""
        return {name: ast.parse(path.read_text("utf-8")) for name, path in self.files.items()}

    @cached_property
    def doors(self) -> dict[str, dict[str, str]]:
        """By house, the names that its door offers, and the modules that define them."""
        found: dict[str, dict[str, str]] = {}
        for house in sorted({house_of(name) for name in self.files}):
            for file in ("__init__.pyi", "__init__.py"):
                path = self.package / house / file
                if path.is_file():
                    found[house] = dict(self._offered(house, path)) | found.get(house, {})
        return found

    def _offered(self, house: str, path: Path) -> Iterator[tuple[str, str]]:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level == 1:
                for alias in node.names:
                    yield alias.asname or alias.name, f"{house}.{node.module}"

    @cached_property
    def taken(self) -> tuple[Taken, ...]:
        """Every name that a module takes from another module."""
        return tuple(dict.fromkeys(each for name in self.files for each in self._taken_by(name)))

    def _taken_by(self, module: str) -> Iterator[Taken]:
        package = module.split(".")
        if self.files[module].name != "__init__.py":
            package = package[:-1]
        whole: dict[str, str] = {}
        for node in ast.walk(self.trees[module]):
            if not isinstance(node, ast.ImportFrom) or not node.level:
                continue
            base = package[: len(package) - node.level + 1]
            if node.module:
                base = base + node.module.split(".")
            source = ".".join(base)
            for alias in node.names:
                if f"{source}.{alias.name}".lstrip(".") in self.files:
                    whole[alias.asname or alias.name] = f"{source}.{alias.name}".lstrip(".")
                elif source in self.doors:
                    home = self.doors[source].get(alias.name, source)
                    yield Taken(module, home, alias.name, True)
                elif source:
                    yield Taken(module, source, alias.name, False)
        read = defaultdict(set)
        for node in ast.walk(self.trees[module]):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                read[node.value.id].add(node.attr)
        for local, source in whole.items():
            for name in sorted(read[local]) or [""]:
                yield Taken(module, source, name, False)

    @cached_property
    def crossing(self) -> tuple[Taken, ...]:
        """What is taken from another house."""
        return tuple(t for t in self.taken if house_of(t.by) != house_of(t.module))

    def door(self, house: str) -> dict[tuple[str, str], set[str]]:
        """The names that others take from a house, with the modules that take them."""
        found: dict[tuple[str, str], set[str]] = defaultdict(set)
        for taken in self.crossing:
            if house_of(taken.module) == house:
                found[taken.module, taken.name].add(taken.by)
        return dict(found)

    @cached_property
    def arrows(self) -> Counter[tuple[str, str]]:
        """Pairs of houses of which the first imports from the second, and how many names."""
        pairs = {(house_of(t.by), house_of(t.module), t.module, t.name) for t in self.crossing}
        return Counter((importer, imported) for importer, imported, *_ in pairs)

    @cached_property
    def imports(self) -> dict[str, set[str]]:
        """By module, the modules that it imports; a package is not tied to its own parts."""
        found: dict[str, set[str]] = {name: set() for name in self.files}
        for taken in self.taken:
            if taken.module in found and not taken.module.startswith(f"{taken.by}."):
                found[taken.by].add(taken.module)
            found[taken.by].discard(taken.by)
        return found


def house_of(module: str) -> str:
    """The house of a module."""
    return module.partition(".")[0]


def cycles(graph: Mapping[str, Iterable[str]]) -> list[set[str]]:
    """Groups of nodes that reach one another."""
    reach = {node: set(graph[node]) for node in graph}
    for middle in graph:
        for node in graph:
            if middle in reach[node]:
                reach[node] |= reach[middle]
    found: list[set[str]] = []
    for node in graph:
        group = {other for other in reach[node] if node in reach.get(other, set())}
        if node in group and group not in found:
            found.append(group)
    return found


def tokens(text: str) -> int:
    """Tokens of Python, without comments, docstrings and layout."""
    made = tokenize.generate_tokens(io.StringIO(text).readline)
    docstrings = sum(
        ast.get_docstring(node, clean=False) is not None
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef)
    )
    return sum(token.type not in _LAYOUT for token in made) - docstrings


def containers(tree: ast.AST) -> Iterator[str]:
    """Names of classes that hold data: dataclasses and named tuples."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef):
            decorators = [ast.unparse(each) for each in node.decorator_list]
            bases = [ast.unparse(each) for each in node.bases]
            if any(each.startswith("dataclass") for each in decorators) or "NamedTuple" in bases:
                yield node.name


def packed(tree: ast.AST) -> int:
    """Assignments of several values to several names in one statement: a, b = x, y."""
    return sum(
        isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Tuple)
        and isinstance(node.value, ast.Tuple)
        for node in ast.walk(tree)
    )


def totals(street: Street) -> dict[str, float]:
    """What is counted of a whole package."""
    texts = {name: path.read_text("utf-8") for name, path in street.files.items()}
    classes = Counter(
        node.name
        for tree in street.trees.values()
        for node in ast.walk(tree)
        if isinstance(node, ast.ClassDef)
    )
    assignments = sum(
        isinstance(node, ast.Assign) for tree in street.trees.values() for node in ast.walk(tree)
    )
    together = sum(packed(tree) for tree in street.trees.values())
    return {
        "files": len(street.files),
        "houses": len({house_of(name) for name in street.files}),
        "names at doors": sum(len(street.door(house)) for house in street.doors),
        "arrows between houses": len(street.arrows),
        "cycles of modules": len(cycles(street.imports)),
        "tokens": sum(tokens(text) for text in texts.values()),
        "containers": sum(len(list(containers(tree))) for tree in street.trees.values()),
        "packed assignments": together,
        "packed assignments, % of all": round(100 * together / assignments, 1),
        "class names used twice": sum(count > 1 for count in classes.values()),
        "fmt: skip": sum(text.count("# fmt: skip") for text in texts.values()),
    }


def table(street: Street) -> str:
    """Houses with their doors and arrows, then the totals, as Markdown."""
    houses = sorted({house_of(name) for name in street.files})
    if set(houses) <= set(STREET):
        houses = [house for house in STREET if house in houses]
    rows = ["| house | files | names at its door | imports from |", "|---|---|---|---|"]
    for house in houses:
        own = sum(house_of(name) == house for name in street.files)
        to = ", ".join(
            f"{other} {street.arrows[house, other]}"
            for other in houses
            if street.arrows[house, other]
        )
        rows.append(f"| {house} | {own} | {len(street.door(house))} | {to} |")
    rows += ["", "| whole package | |", "|---|---|"]
    rows += [f"| {name} | {value:,} |" for name, value in totals(street).items()]
    return "\n".join(rows)


def names(street: Street, house: str) -> str:
    """The names that others take from a house, by module, with the houses that take each."""
    lines: list[str] = []
    last = ""
    for (module, name), users in sorted(street.door(house).items()):
        if module != last:
            lines.append(module)
            last = module
        by = sorted({house_of(user) for user in users})
        lines.append(f"    {name or '(the module)'}  {len(users)}  {', '.join(by)}")
    return "\n".join(lines)


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument(
        "folder", nargs="?", type=Path, default=PACKAGE, help="the package's folder"
    )
    parser.add_argument("--names", metavar="HOUSE", help="list the names at this door")
    given = parser.parse_args()
    street = Street(given.folder)
    print(names(street, given.names) if given.names else table(street))


if __name__ == "__main__":
    main()
