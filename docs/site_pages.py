"""Makes pages of the site of what is not written for it: mkdocs calls these functions (`hooks` in mkdocs.yml).

The pages of docs/ link to files all over the project, as one reads them in a checkout. The project has no public
address to which the site could point instead. So a few of those files become pages of the site, and of any other file
the name is shown. Notebooks are run, and what they showed becomes their page; one that fails ends the build.
"""

from __future__ import annotations

import posixpath
import re
import tempfile
from pathlib import Path, PurePosixPath
from typing import Any

import pipeline

ROOT = Path(__file__).resolve().parents[1]
PAGES = {"CONTRIBUTING.md": "contributing.md", "CHANGELOG.md": "changelog.md", "data/README.md": "data.md"}
"""Files outside of docs/ that have a page of the site, and under which name."""
NAMES = "<!-- every public name -->"
"""Stands in reference.md where the names of `pipeline` belong."""
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!\w+:)([^)#\s]*)(#[^)\s]*)?\)")
PATIENCE = 600  # seconds for a cell of a notebook; the first one may have to compile the loops of the filter


def on_files(files: Any, config: Any) -> Any:
    """Add the pages that lie outside of docs/, and those of the notebooks."""
    from mkdocs.structure.files import File

    for source, page in PAGES.items():
        files.append(File.generated(config, page, content=(ROOT / source).read_text(encoding="utf-8")))
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        for page, content in executed(Path(notebook.abs_src_path)).items():
            path = f"{posixpath.dirname(notebook.src_uri)}/{page}"
            files.append(File.generated(config, path, content=content))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Change links into those of the site, and name the public names where they belong."""
    outside = {name: source for source, name in PAGES.items()}
    source = outside.get(page.file.src_uri, f"docs/{page.file.src_uri}")
    return relinked(markdown, source).replace(NAMES, public_names())


def relinked(markdown: str, source: str) -> str:
    """The text of a page with the links as the site has them; ``source``: the page's path below the project's root."""
    here = posixpath.dirname(PAGES.get(source, source.removeprefix("docs/")))

    def moved(link: re.Match[str]) -> str:
        picture, words, target, anchor = link[1], link[2], link[3], link[4] or ""
        if not target:
            return link[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        if path.startswith("docs/"):
            page = path.removeprefix("docs/").replace(".ipynb", ".md")
        elif path == "README.md":
            page, anchor = "index.md", ""
        elif path in PAGES:
            page = PAGES[path]
        else:
            return f"`{path}`" if PurePosixPath(path).name in words else f"{words} (`{path}`)"
        return f"{picture}[{words}]({posixpath.relpath(page, here or '.')}{anchor})"

    return LINK.sub(moved, markdown)


def executed(notebook: Path) -> dict[str, str | bytes]:
    """The page of a notebook, run in an empty folder from its first cell to its last, and its pictures, by name."""
    import nbformat
    from nbclient import NotebookClient
    from nbconvert import MarkdownExporter

    cells = nbformat.read(notebook, as_version=4)
    with tempfile.TemporaryDirectory() as folder:
        patience = {"timeout": PATIENCE, "startup_timeout": PATIENCE}
        client = NotebookClient(cells, kernel_name="python3", extra_arguments=["--log-level=ERROR"], **patience)
        client.execute(cwd=folder)
    resources = {"unique_key": notebook.stem, "output_files_dir": ""}
    markdown, made = MarkdownExporter().from_notebook_node(cells, resources=resources)
    title, _, rest = markdown.lstrip().partition("\n")
    link = f'<a href="{notebook.name}" download>{notebook.name}</a>'
    note = f"This page is a notebook, run when the site was built: {link}."
    return {f"{notebook.stem}.md": f"{title}\n\n{note}\n{rest}", **made["outputs"]}


def public_names() -> str:
    """An instruction for mkdocstrings for each public name, which may be another one where it is defined."""
    shown = []
    for name, (module, defined) in sorted(pipeline._HOMES.items(), key=lambda item: item[0].lower()):
        shown.append(f"::: {module}.{defined}\n    options:\n      heading: {name}\n      toc_label: {name}")
    return "\n\n".join(shown)
