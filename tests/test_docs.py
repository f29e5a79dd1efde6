"""Every code block of every page is run, or says why it is not; the site links nowhere broken.

A block with `title="FILE"` is written to that file. Python blocks of a page share one namespace.
Of a shell block every line is a command; durations and numbers of runs are cut to what a test can
afford. A comment before a block changes this: `<!-- not run: REASON -->`, `<!-- slow: REASON -->`,
or `<!-- tested by FILE -->`.
"""

from __future__ import annotations

import contextlib
import re
import shlex
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.support.faulty import CHECKOUT, flat, shell

DOCS = CHECKOUT / "docs"
PAGES = [CHECKOUT / "README.md", *sorted(DOCS.glob("*.md"))]
BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>not run|slow|tested by):? ?(?P<why>[^\n]*?) -->\n)?"
    r'^```(?P<kind>\w*)(?: title="(?P<title>\S+)")?\n(?P<text>.*?)^```$',
    re.MULTILINE | re.DOTALL,
)
RUN = {"python", "sh"}
SHOWN = {"", "text"}  # diagrams and output
SHORT = {"--duration": "1", "--held-out": "0.5", "--pe-window": "0.5"}


class Block(NamedTuple):
    """A fenced block: the mark before it with its reason, language, file name, text."""

    mark: str
    why: str
    kind: str
    title: str
    text: str


def blocks(page: Path) -> list[Block]:
    found = BLOCK.finditer(page.read_text(encoding="utf-8"))
    return [Block(*(part or "" for part in match.groups())) for match in found]


def name_of(page: Path) -> str:
    return str(page.relative_to(CHECKOUT))


def shortened(words: list[str]) -> list[str]:
    """A command of `nsaid` that ends within seconds."""
    if words[0] not in {"run", "verify", "sweep", "montecarlo"} or "--help" in words:
        return words
    if "--run" in words[:2]:
        return words
    limits = SHORT | {"--seeds": "2"} if words[0] == "sweep" else dict(SHORT)
    limits |= {"--runs": "2"} if words[0] == "montecarlo" else {}
    kept, skip = [], False
    for word in words:
        name = word.partition("=")[0]
        skip, dropped = (name in limits and "=" not in word), skip
        if not dropped and name not in limits:
            kept.append(word)
    return [*kept, *(part for pair in limits.items() for part in pair), "--quiet"]


def carry_out(page: Path, folder: Path, slow: bool) -> None:
    """Runs the blocks of a page in order; slow ones only if asked for."""
    code = ""
    for block in blocks(page):
        if block.title:
            path = folder / block.title
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")
        if block.mark in {"not run", "tested by"} or (block.mark == "slow" and not slow):
            continue
        if block.kind == "python" and not block.title:
            code += block.text
        if block.kind == "sh":
            if code:
                _python(code, folder)
                code = ""
            for line in block.text.splitlines():
                words = shlex.split(line, comments=True)
                if not words:
                    continue
                assert words[:1] == ["nsaid"], f"say why this is not run: {line}"
                own = shortened(words[1:])
                with contextlib.chdir(folder):
                    exit_code, said = shell(*own)
                # what is shortened may not converge
                fine = {0, 1} if own != words[1:] or "✘" in said.out else {0}
                fine |= {2} if "there is no display for a window" in said.err else set()
                assert exit_code in fine and "Traceback" not in said.err, (line, said)
    if code:
        _python(code, folder)


def _python(code: str, folder: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr


QUICK = [DOCS / "record.md", DOCS / "your_law.md"]
ELSEWHERE = {
    "README.md": "tests/test_readme.py",
    "docs/your_robot.md": "tests/test_readme.py",
    "docs/your_vehicle.md": "tests/test_your_vehicle.py",
}
"""Pages whose blocks have a test of their own, which also checks their results."""
SLOW = [page for page in PAGES if page not in QUICK and name_of(page) not in ELSEWHERE]


@pytest.mark.parametrize("page", QUICK, ids=name_of)
def test_the_blocks_of_a_page_run_in_order(page: Path, tmp_path: Path) -> None:
    assert any(block.kind in RUN for block in blocks(page))
    carry_out(page, tmp_path, slow=False)


@pytest.mark.slow
@pytest.mark.parametrize("page", SLOW, ids=name_of)
def test_the_blocks_of_a_longer_page_run_in_order(page: Path, tmp_path: Path) -> None:
    carry_out(page, tmp_path, slow=True)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_a_block_that_is_not_run_says_why(page: Path) -> None:
    fences = re.findall(r"^```\w", page.read_text(encoding="utf-8"), re.MULTILINE)
    found = blocks(page)
    assert len(fences) == sum(bool(block.kind) for block in found)
    for block in found:
        assert block.kind in RUN | SHOWN or block.title or block.mark, block.text
        assert block.why or not block.mark, block.text
        if block.mark == "tested by":
            assert (CHECKOUT / block.why).is_file()
    if name_of(page) in ELSEWHERE:
        assert page.name in (CHECKOUT / ELSEWHERE[name_of(page)]).read_text(encoding="utf-8")


# -- what is printed -----------------------------------------------------------------------------

NUMBER = re.compile(r"\d+(?:\.\d+)?")


def examples(page: Path) -> list[tuple[str, list[str]]]:
    """The commands whose output a page shows, each with the lines shown."""
    shown = [block.text.splitlines() for block in blocks(page) if block.text.startswith("$ ")]
    return [(first.removeprefix("$ "), rest) for first, *rest in shown]


EXAMPLES = [(name_of(page), *example) for page in PAGES for example in examples(page)]


@pytest.mark.parametrize(("page", "line", "shown"), EXAMPLES)
def test_a_command_prints_what_a_page_shows(
    page: str, line: str, shown: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether words are equal, and numbers to two per cent, which is less than a law's change."""
    monkeypatch.chdir(tmp_path)
    _, said = shell(*shlex.split(line)[1:])
    printed = {NUMBER.sub("#", flat(each)): each for each in said.out.splitlines()}
    for each in map(flat, shown):
        found = printed.get(NUMBER.sub("#", each))
        assert found is not None, f"{page}: {line} no longer prints {each}"
        now, then = ([float(x) for x in NUMBER.findall(text)] for text in (found, each))
        assert now == pytest.approx(then, rel=0.02), f"{page}: {line} prints {found}"


@pytest.mark.slow
@pytest.mark.parametrize("story", ["arm", "rov", "legs"])
def test_identify_prints_what_docs_output_shows(story: str) -> None:
    words = [sys.executable, "-m", "scripts.output", "--check", story]
    said = subprocess.run(words, cwd=CHECKOUT, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr


def test_every_page_is_in_the_sites_navigation() -> None:
    nav = (CHECKOUT / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    nav = re.sub(r"#.*", "", nav)
    pages = {page.name for page in DOCS.glob("*.md")}
    pages |= {"changelog.md", "security.md"}  # that the site makes of the files at the top
    assert pages == set(re.findall(r": (\w+\.md)", nav))


# -- the built site ------------------------------------------------------------------------------


class Links(HTMLParser):
    """What a page of HTML links and loads, and its anchors."""

    def __init__(self, text: str):
        super().__init__()
        self.targets: set[str] = set()
        self.loaded: set[str] = set()
        self.anchors: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.anchors |= {found[key] or "" for key in ("id", "name") if key in found}
        if tag == "a" and found.get("href"):
            self.targets.add(found["href"] or "")
        if tag in {"img", "script", "link"}:
            self.loaded.add(found.get("src") or found.get("href") or "")


@pytest.mark.slow
def test_the_site_builds_strictly_links_nowhere_broken_and_loads_nothing_from_elsewhere(
    tmp_path: Path,
) -> None:
    pytest.importorskip("mkdocs")
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    built = subprocess.run(
        [*words, "--site-dir", str(tmp_path)],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert built.returncode == 0, built.stderr
    pages = {path: Links(path.read_text("utf-8")) for path in tmp_path.rglob("*.html")}
    assert len(pages) > 40
    for path, page in pages.items():
        assert not [file for file in page.loaded if re.match(r"(https?:)?//", file)], path
        if path.name == "404.html":  # its links are absolute
            continue
        for target in page.targets:
            if re.match(r"[a-z]+:", target):
                continue
            file, _, anchor = target.partition("#")
            other = (path.parent / file).resolve() if file else path
            assert other.is_file(), (path, target)
            if anchor and other in pages:
                assert anchor in pages[other].anchors, (path, target)
