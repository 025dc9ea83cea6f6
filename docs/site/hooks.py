"""Hooks of mkdocs: pages from declarations, notebooks with outputs, and figures of the results.

Links that are right in the repository are made right in the site: figures of ``results/`` are
copied next to the pages, and README.md, CONTRIBUTING.md and CHANGELOG.md become pages.
"""

import base64
import os
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import latex2mathml.converter
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))
import reference

ROOT = Path(__file__).parents[2]
#: Files of the repository that are pages of the site.
PROJECT = {
    "index.md": "README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changes.md": "CHANGELOG.md",
    "security.md": "SECURITY.md",
}
_FIGURE = re.compile(r"\]\((?:\.\./)*results/figures/([\w.-]+)\)")
_FORMULA = re.compile(r"^```math\n(.*?)^```$", re.DOTALL | re.MULTILINE)
_PLAIN = re.compile("\x1b\\[[0-9;]*m")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add what is generated."""
    for path, name in PROJECT.items():
        text = (ROOT / name).read_text(encoding="utf-8").replace("](docs/", "](")
        files.append(File.generated(config, path, content=_between_pages(text, "")))
    shown = set()
    for page in (*Path(config.docs_dir).rglob("*.md"), ROOT / "README.md"):
        shown |= set(_FIGURE.findall(page.read_text(encoding="utf-8")))
    for name in sorted(shown):
        source = ROOT / "results/figures" / name
        files.append(File.generated(config, f"figures/{name}", abs_src_path=str(source)))
    for notebook in sorted(Path(config.docs_dir, "examples").glob("*.ipynb")):
        for path, content in _executed(notebook).items():
            files.append(File.generated(config, f"examples/{path}", content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links to figures of the results and to pages of the repository, from a page anywhere."""
    up = "../" * page.file.src_uri.count("/")
    markdown = _between_pages(markdown, f"../{up}", up)
    if page.file.src_uri == "verification.md":
        for place, table in reference.claim_tables().items():
            markdown = markdown.replace(place, table)
    if page.file.src_uri == "reference/api.md":
        markdown += reference.docstrings()
    markdown = _FORMULA.sub(_mathml, markdown)
    return _FIGURE.sub(rf"]({up}figures/\1)", markdown)


def _between_pages(markdown: str, root: str, up: str = "") -> str:
    """Links to files of the repository, whose path begins with `root`, as links to pages."""
    for path, name in PROJECT.items():
        markdown = re.sub(
            rf"\]\({re.escape(root + name)}(#[^)]*)?\)", rf"]({up}{path}\1)", markdown
        )
    return markdown


def _mathml(formula: re.Match[str]) -> str:
    """A formula as MathML, which browsers set without a script."""
    return latex2mathml.converter.convert(formula[1], display="block")


# -- notebooks ------------------------------------------------------------------------------------


def _executed(path: Path) -> dict[str, str | bytes]:
    """A notebook as a page with the outputs of a run, and its figures.

    With NOTEBOOKS=no in the environment nothing is run, and there are no outputs.
    """
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    if os.environ.get("NOTEBOOKS") != "no":
        with tempfile.TemporaryDirectory() as away:
            resources = {"metadata": {"path": away}}
            NotebookClient(notebook, timeout=240, resources=resources).execute()
    found: dict[str, str | bytes] = {}
    parts = []
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            parts.append(cell.source)
            continue
        parts.append(f"```python\n{cell.source}\n```")
        for output in cell.outputs:
            shown, image = _shown(output)
            if image:
                name = f"{path.stem}-{len(found) + 1}.png"
                found[name] = image
                shown = f"![{_alternative(cell.source)}]({name})"
            if shown:
                parts.append(shown)
    source = f"[The notebook]({path.name}), without outputs, can be run anywhere."
    title, _, rest = "\n\n".join(parts).partition("\n")
    return {f"{path.stem}.md": f"{title}\n\n{source}\n{rest}\n", **found}


def _shown(output: Any) -> tuple[str, bytes]:
    """Markdown of an output, or an image."""
    data = output.get("data", {})
    if "image/png" in data:
        return "", base64.b64decode(data["image/png"])
    if "text/html" in data:
        html = re.sub(r"<style.*?</style>", "", data["text/html"], flags=re.DOTALL)
        return re.sub(r"\n\s*", "", html), b""
    text = data.get("text/plain", output.get("text", ""))
    return (f'<div class="output" markdown>\n\n```text\n{_PLAIN.sub("", text).rstrip()}\n```\n\n'
            "</div>", b"") if text else ("", b"")  # fmt: skip


def _alternative(source: str) -> str:
    """Text of a figure: the first comment of its cell."""
    first = source.strip().partition("\n")[0]
    return first.lstrip("# ") if first.startswith("#") else "figure of the cell above"
