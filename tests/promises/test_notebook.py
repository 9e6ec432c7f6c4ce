"""The notebook, and the cells of docs/how-to/notebook.md in one: tables as HTML, figures as PNG, and no error."""

from __future__ import annotations

import doctest
import os
from base64 import b64decode
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from nbformat import NotebookNode
from nbformat.v4 import new_code_cell, new_notebook

ROOT = Path(__file__).parents[2]
NOTEBOOK = ROOT / "docs" / "notebooks" / "first-steps.ipynb"
PAGE = ROOT / "docs" / "how-to" / "notebook.md"


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder for a kernel that has this checkout and none of its user's settings."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    home, work = tmp_path / "home", tmp_path / "work"
    home.mkdir()
    work.mkdir()
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(home / name))
    return work


def execute(notebook: NotebookNode, work: Path) -> None:
    """Run the cells of a notebook by a kernel of its own process, as a user's has it."""
    NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": work}}).execute()


def test_the_notebook_holds_no_output() -> None:
    """`make wheel` runs the same one where only the wheel is installed."""
    stored = nbformat.read(NOTEBOOK, as_version=4)
    assert all(not cell.get("outputs") and cell.get("execution_count") is None for cell in stored.cells)


def test_the_notebook_runs_from_top_to_bottom(work: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    execute(notebook, work)
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert {output.output_type for output in outputs} == {"execute_result"}
    assert sum("image/png" in output.data for output in outputs) == 3
    assert sum("text/html" in output.data for output in outputs) >= 3
    assert not [*work.iterdir()]


def test_the_cells_of_the_page_show_tables_and_figures(work: Path) -> None:
    """Each example is a cell, run by a kernel of its own process as a user's notebook has it."""
    examples = doctest.DocTestParser().get_examples(PAGE.read_text(encoding="utf-8"))
    notebook = new_notebook(cells=[new_code_cell(example.source) for example in examples])
    execute(notebook, work)
    tables = figures = 0
    for example, cell in zip(examples, notebook.cells, strict=True):
        shown = [output.data for output in cell.outputs if output.output_type == "execute_result"]
        assert len(shown) == (1 if example.want and "print(" not in example.source else 0), example.source
        if example.want.startswith("<Drawing"):
            assert b64decode(shown[0]["image/png"]).startswith(b"\x89PNG")
            figures += 1
        elif "..." in example.want:
            assert shown[0]["text/html"].startswith("<table>")
            assert example.want.partition(":")[0] in shown[0]["text/html"]
            tables += 1
    assert (tables, figures) == (3, 4)
    assert not [*work.iterdir()]
