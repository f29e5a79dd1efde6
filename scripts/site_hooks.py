"""What mkdocs needs beyond the pages in docs/: generated pages, and links that leave the folder.

Pages of marked source files, of the vehicles' sources, of the changelog and of the security policy
are made at build time; the table of equations is put in the place of its marker. The search finds
source files and the changelog after all other pages, and the reference of Python after the guides.
"""

import re
import sys
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

sys.path.insert(0, str(Path(__file__).parent))
import equations

ROOT = Path(__file__).parents[1]
MARKER = "<!-- the table of equations -->"
_LAST = "---\nsearch:\n  boost: 0.1\n---\n"
"""Front matter of pages that the search finds after the others."""
_TEXT = re.compile(r"\[(\w+\.md)\]\((\1[^)]*)\)")
_SUBSCRIPT = re.compile(r"(?<=[^\x00-\x7f])_|_(?=[^\x00-\x7f])")
_SOURCE = re.compile(r"\]\(\.\./assets/(\w+)/SOURCE\.md\)")


def escaped(markdown: str) -> str:
    """The text with underscores of symbols such as P̄_⊥ escaped, as they are no emphasis."""
    lines, fenced = [], False
    for line in markdown.splitlines():
        fenced ^= line.startswith("```")
        if not fenced and not line.startswith("    "):
            parts = line.split("`")
            parts[::2] = [_SUBSCRIPT.sub(r"\\_", part) for part in parts[::2]]
            lines.append("`".join(parts))
        else:
            lines.append(line)
    return "\n".join(lines) + "\n"


def titles(nav: Any) -> dict[str, str]:
    """The title of every page in the navigation, by its file."""
    found: dict[str, str] = {}
    for entry in nav:
        for title, target in entry.items():
            found |= titles(target) if isinstance(target, list) else {target: title}
    return found


def on_files(files: Any, config: Any) -> Any:
    """Adds a page for every source file with a marked equation, and for every SOURCE.md."""
    for path in equations.marked_files():
        name = path.relative_to(equations.PACKAGE)
        text = f'{_LAST}# nsaid_mj/{name}\n\n```python linenums="1"\n{path.read_text("utf-8")}```\n'
        files.append(File.generated(config, f"code/{name.with_suffix('.md')}", content=text))
    for path in sorted((ROOT / "assets").glob("*/SOURCE.md")):
        text = f"{_LAST}<!-- {path.parent.name} -->\n{path.read_text('utf-8')}"
        files.append(File.generated(config, f"sources/{path.parent.name}.md", content=text))
    for name in ("CHANGELOG.md", "SECURITY.md"):
        text = _LAST + (ROOT / name).read_text("utf-8").replace("](docs/", "](")
        files.append(File.generated(config, name.lower(), content=text))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Puts in the table of equations, page titles for file names, and links to SOURCE.md pages."""
    if page.file.src_uri == "reference.md":
        page.meta["search"] = {"boost": 0.5}
    known = titles(config["nav"])
    markdown = _TEXT.sub(lambda m: f"[{known.get(m[1], m[1])}]({m[2]})", markdown)
    if MARKER in markdown:
        markdown = markdown.replace(MARKER, equations.table())
    markdown = escaped(markdown)
    return _SOURCE.sub(r"](sources/\1.md)", markdown)
