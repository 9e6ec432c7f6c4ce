"""The cells of docs/how-to/notebook.md in a notebook: tables as HTML, figures as PNG, and no error."""

from __future__ import annotations

import doctest
import os
from base64 import b64decode
from pathlib import Path

import pytest
from nbclient import NotebookClient
from nbformat.v4 import new_code_cell, new_notebook

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs" / "how-to" / "notebook.md"


def test_the_cells_of_the_page_show_tables_and_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each example is a cell, run by a kernel of its own process as a user's notebook has it."""
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    examples = doctest.DocTestParser().get_examples(PAGE.read_text(encoding="utf-8"))
    home, work = tmp_path / "home", tmp_path / "work"
    home.mkdir()
    work.mkdir()
    for name in ("IPYTHONDIR", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"):
        monkeypatch.setenv(name, str(home / name))
    notebook = new_notebook(cells=[new_code_cell(example.source) for example in examples])
    NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": work}}).execute()
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
    assert tables == figures == 3
    assert not [*work.iterdir()]
