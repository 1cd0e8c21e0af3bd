"""Adds the pages that are not committed: automcm_maintenance.documents.built_pages."""

from __future__ import annotations

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from automcm_maintenance.documents import built_pages


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """A page of that name on disk, which ``make evaluation`` writes, is replaced."""
    for name, make in built_pages.pages().items():
        if (old := files.get_file_from_path(name)) is not None:
            files.remove(old)
        files.append(File.generated(config, name, content=make()))
    return files
