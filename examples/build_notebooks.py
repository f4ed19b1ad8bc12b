"""Write the notebooks of this folder, executed, from their sources in notebooks/.

python examples/build_notebooks.py [NAME ...]

A source is plain Python with cells (see ehsa_ctrl/core/notebook.py); lines before the first cell are for the linter. A
notebook stores the outputs of its cells, but not the machine or the time of execution.
"""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

from ehsa_ctrl.core.notebook import METADATA, notebook_of

SOURCES = Path(__file__).resolve().parent / "notebooks"


def read(source):
    """The notebook of a source, not executed."""
    return nbformat.from_dict(notebook_of(source.read_text(encoding="utf-8")))


def main(names):
    for source in sorted(SOURCES.glob("*.py")):
        if names and source.stem not in names:
            continue
        notebook = read(source)
        NotebookClient(notebook, timeout=600, kernel_name="python3", record_timing=False).execute()
        notebook.metadata = METADATA
        nbformat.validate(notebook)
        target = SOURCES.parent / f"{source.stem}.ipynb"
        nbformat.write(notebook, target)
        print(f"{target.name}: {len(notebook.cells)} cells, {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main(sys.argv[1:])
