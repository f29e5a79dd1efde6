"""What mkdocs needs beyond the pages in docs/: generated pages, and links that leave the folder.

Pages of marked source files and of the vehicles' sources are made at build time; the table of
equations is put in the place of its marker.
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
_SOURCE = re.compile(r"\]\(\.\./assets/(\w+)/SOURCE\.md\)")


def on_files(files: Any, config: Any) -> Any:
    """Adds a page for every source file with a marked equation, and for every SOURCE.md."""
    for path in equations.marked_files():
        name = path.relative_to(equations.PACKAGE)
        text = f'# nsaid_mj/{name}\n\n```python linenums="1"\n{path.read_text("utf-8")}```\n'
        files.append(File.generated(config, f"code/{name.with_suffix('.md')}", content=text))
    for path in sorted((ROOT / "assets").glob("*/SOURCE.md")):
        text = f"<!-- {path.parent.name} -->\n{path.read_text('utf-8')}"
        files.append(File.generated(config, f"sources/{path.parent.name}.md", content=text))
    return files


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Puts in the table of equations, and leads links to SOURCE.md files to their pages."""
    if MARKER in markdown:
        markdown = markdown.replace(MARKER, equations.table())
    return _SOURCE.sub(r"](sources/\1.md)", markdown)
