"""Links of the site: a page by its title, a rule or property by its id, a model by its name.

``[adapter.md](adapter.md)``, NEG-4 and ``retarget`` stand in the pages; their links are made when
the site is built.
"""

from __future__ import annotations

import posixpath
import re

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page
from mkdocs.utils import get_relative_url

from automcm_maintenance.documents.citations import summaries
from automcm_spec.model_checking import models

NAMED = re.compile(r"\[[\w./-]+\.md\](?=\(([\w./-]+\.md)[)#])")
TITLE = re.compile(r"^# (.+)", re.MULTILINE)
REFERENCE = re.compile(
    r"<(?P<kept>a|pre|svg|span|h[1-6])\b.*?</(?P=kept)>|<code>(?P<model>\w+)</code>|<code>.*?</code>"
    rf"|<[^>]*>|(?<![\w-])(?P<id>{'|'.join(summaries())})(?![\w-])",
    re.DOTALL,
)
"""A rule, property or model, or what holds none: a link, a heading, other code, a tag."""
MODELS = {model.cfg for model in models.load()}
OTHER_WORDS = re.compile(r"cli.*|trace-format.md|vectors.md")
"""Pages in which ``drift`` or ``together`` is no model."""
ANCHORS = {
    "protocol.md": re.compile(r"(?:<tr>\n<td>|(?<=\d, ))([A-Z]-\d+)(?=</td>|, [A-Z]-\d+</td>)"),
    "models.md": re.compile(r"<tr>\n<td>(?:<a [^>]*>)?<code>(\w+)(?=</code>)"),
}
"""A property or a model is defined in the first cell of a row, two properties at most."""


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """The text of a link is the title of the page to which it leads."""

    def titled(link: re.Match[str]) -> str:
        folder = posixpath.dirname(page.file.src_uri)
        target = files.get_file_from_path(posixpath.normpath(posixpath.join(folder, link[1])))
        title = target and TITLE.search(target.content_string)
        return f"[{title[1]}]" if title else link[0]

    return NAMED.sub(titled, markdown)


def _anchored(cell: re.Match[str]) -> str:
    before = cell[0].removesuffix(cell[1])
    return f'{before}<span id="{cell[1]}">{cell[1]}</span>'


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to rules, properties and models, and the anchors of the latter two."""
    here = page.file.src_uri
    if here in ANCHORS:
        html = ANCHORS[here].sub(_anchored, html)

    def linked(found: re.Match[str]) -> str:
        name, anchor = "protocol.md", found["id"]
        if found["model"] in MODELS and ("_" in found["model"] or not OTHER_WORDS.fullmatch(here)):
            name, anchor = "models.md", found["model"]
        target = files.get_file_from_path(name)
        if not anchor or target is None:
            return found[0]
        slug = anchor.lower() if len(anchor.split("-")[0]) == 3 else anchor  # a heading, or a row
        return f'<a href="{get_relative_url(target.url, page.url)}#{slug}">{found[0]}</a>'

    return REFERENCE.sub(linked, html)
