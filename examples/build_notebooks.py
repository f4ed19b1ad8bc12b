"""Write the notebooks of this folder, executed, from their sources in notebooks/.

python examples/build_notebooks.py [NAME ...]

A source is plain Python: `# %%` begins a code cell, `# %% [markdown]` a text cell whose lines are comments. Lines
before the first cell are for the linter. A notebook stores the outputs of its cells, but not the machine or the time of
execution.
"""

import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

SOURCES = Path(__file__).resolve().parent / "notebooks"
METADATA = {
    "kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"},
    "language_info": {"name": "python"},
}


def read(source):
    """The notebook of a source, not executed."""
    cells = []
    for part in f"\n{source.read_text(encoding='utf-8')}".split("\n# %%")[1:]:
        head, _, body = part.partition("\n")
        number = f"{len(cells):02d}"
        if head.strip() == "[markdown]":
            lines = [line.removeprefix("#").removeprefix(" ") for line in body.strip().splitlines()]
            cells.append(nbformat.v4.new_markdown_cell("\n".join(lines), id=f"text-{number}"))
        else:
            cells.append(nbformat.v4.new_code_cell(body.strip(), id=f"code-{number}"))
    return nbformat.v4.new_notebook(cells=cells, metadata=METADATA)


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
