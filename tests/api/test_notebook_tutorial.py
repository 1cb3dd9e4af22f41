"""The notebook among the tutorials runs from its first cell to its last, in a kernel as a reader has it."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.full

NOTEBOOK = Path(__file__).parents[2] / "docs/tutorial/notebook.ipynb"
TIMEOUT_S = 120


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_every_cell_runs_and_shows_what_the_text_says(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(notebook, timeout=TIMEOUT_S, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    shown = [
        output["data"]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output["output_type"] == "execute_result"
    ]
    assert "run.duration_s" in shown[0]["text/html"]
    assert "<svg" in shown[1]["text/html"]
    assert "image/png" in shown[2]
    assert "<svg" in shown[5]["text/html"], "the run with a controller of the notebook's own"
    assert "integral" in shown[6]["text/html"]
    assert "stopped" in shown[7]["text/plain"]
    assert "NOT retracted" in shown[7]["text/plain"], "the text says that `left` promises nothing"
    assert shown[-1]["text/plain"].startswith("<Recording: completed")
    assert not any(cell.get("outputs") for cell in nbformat.read(NOTEBOOK, as_version=4).cells), (
        "no outputs are kept"
    )
