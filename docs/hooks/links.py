"""Links that leave docs/ lead to a copy of the file, as text; to a folder, to a list of names.

``[x](../spec/models/x.cfg)`` is right where the repository is read; the site has no such folder.
"""

from __future__ import annotations

import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

OUTSIDE = re.compile(r"\]\(\.\./([^)#\s]+)(?:#[^)]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what the pages at the top of docs/ link to; those in folders link
    within docs/.  Raises PluginError if it is not there."""
    root = Path(config.config_file_path).parent
    linked = {
        name: page.src_uri
        for page in files.documentation_pages()
        if "/" not in page.src_uri
        for name in OUTSIDE.findall(page.content_string)
    }
    for name, page in sorted(linked.items()):
        path = root / name
        try:
            text = _names(path) if path.is_dir() else path.read_text(encoding="utf-8")
        except OSError as error:
            raise PluginError(f"{page}: ../{name}: {error.strerror}") from None
        files.append(File.generated(config, _copy(name), content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The links lead to the copies."""
    if "/" in page.file.src_uri:
        return markdown
    return OUTSIDE.sub(lambda found: f"]({_copy(found[1])})", markdown)


def _names(folder: Path) -> str:
    return "".join(f"{path.name}\n" for path in sorted(folder.iterdir()))


def _copy(name: str) -> str:
    return f"repository/{name}.txt"
