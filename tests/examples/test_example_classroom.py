"""The notebook runs from a fresh kernel, and its saved outputs are what it shows."""

from __future__ import annotations

import base64
import copy
import io
import os
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

BOOK = Path(__file__).parents[2] / "docs/examples/classroom.ipynb"


def results(book):
    """Return what cells print and their pictures, without notes that kernels are being compiled."""
    texts, pictures = [], []
    for cell in book.cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if "rasterjit:" in str(data):
                continue
            if "image/png" in data:
                with Image.open(io.BytesIO(base64.b64decode(data["image/png"]))) as picture:
                    pictures.append(np.array(picture))
            else:
                texts.append(output.get("text") or data["text/plain"])
    return texts, pictures


def test_the_notebook_runs_and_shows_what_was_saved(tmp_path):
    if not os.environ.get("CI"):
        pytest.importorskip("nbclient")
        pytest.importorskip("ipykernel")
    # They take long to import, and no other test needs them.
    import nbclient
    import nbformat

    saved = nbformat.read(BOOK, as_version=4)
    nbformat.validate(saved)
    book = copy.deepcopy(saved)
    for cell in book.cells:
        if cell.cell_type == "code":
            cell.outputs = []
    where = {"metadata": {"path": str(tmp_path)}}
    nbclient.NotebookClient(book, timeout=300, kernel_name="python3", resources=where).execute()
    (texts, pictures), (old_texts, old_pictures) = results(book), results(saved)
    assert texts == old_texts
    assert len(texts) > 6
    assert len(pictures) == len(old_pictures) == 1
    assert np.array_equal(pictures[0], old_pictures[0])
    assert BOOK.stat().st_size < 40_000
