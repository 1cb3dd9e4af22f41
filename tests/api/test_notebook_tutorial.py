"""The notebook tutorial runs completely in a kernel."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

pytestmark = pytest.mark.full

NOTEBOOK = Path(__file__).parents[2] / "docs/tutorial/notebook.ipynb"
TIMEOUT_S = 120


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::pytest.PytestUnraisableExceptionWarning")
def test_notebook_tutorial_cells_show_documented_output(tmp_path: Path) -> None:
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    client = NotebookClient(notebook, timeout=TIMEOUT_S, resources={"metadata": {"path": str(tmp_path)}})
    client.execute()
    outputs = [
        output["data"]
        for cell in notebook.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if output["output_type"] == "execute_result"
    ]
    assert "run.duration_s" in outputs[0]["text/html"]
    assert "<svg" in outputs[1]["text/html"]
    assert "image/png" in outputs[2]
    assert "<svg" in outputs[5]["text/html"], "the run with the notebook's controller"
    assert "integral" in outputs[6]["text/html"]
    assert "stopped" in outputs[7]["text/plain"]
    assert "NOT retracted" in outputs[7]["text/plain"], "the text says that `left` is not guaranteed"
    assert outputs[-1]["text/plain"].startswith("<Recording: completed")
    assert not any(cell.get("outputs") for cell in nbformat.read(NOTEBOOK, as_version=4).cells), (
        "no outputs are kept"
    )
