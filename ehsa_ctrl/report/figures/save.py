"""Save figures reproducibly: the same figure gives the same bytes."""

from __future__ import annotations

import re
from io import BytesIO, StringIO
from pathlib import Path

from matplotlib.figure import Figure
from PIL import Image

from ..style import DPI, style

#: Omits date and matplotlib version from the file, for reproducibility.
NO_DATE = {"Date": None, "Creator": None, "Format": None, "Type": None}
#: Colours of a PNG, shades at edges included (engineering judgement).
COLOURS = 64


def to_svg(figure: Figure) -> str:
    """The figure as SVG text; characters are outlines, so that it looks the same everywhere."""
    stream = StringIO()
    with style():
        figure.savefig(stream, format="svg", dpi=DPI, metadata=NO_DATE)
    return re.sub(
        r'(?<= d=")[^"]+', lambda path: re.sub(r"\d+\.\d{3,}", _shorter, path[0]).replace("\n", ""), stream.getvalue()
    )


def _shorter(digits: re.Match[str]) -> str:
    """Round coordinates to two decimals of a point (4 um on paper), which halves the file."""
    return f"{float(digits[0]):.2f}".rstrip("0").rstrip(".")


def save(figure: Figure, path: str | Path) -> tuple[Path, Path]:
    """Write `path`.png (150 dpi) and `path`.svg and return both paths; creates missing folders."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Not with_suffix: a name may contain a dot ("pid_v1.2").
    png, svg = path.with_name(path.name + ".png"), path.with_name(path.name + ".svg")
    drawn = BytesIO()
    with style():
        figure.savefig(drawn, format="rgba", dpi=DPI)
    width, height = figure.get_size_inches()
    size = int(width * DPI), int(height * DPI)
    # Few colours with their shades make a file a third as large, and pages that hold it.
    image = Image.frombytes("RGBA", size, drawn.getvalue()).convert("RGB").quantize(COLOURS, dither=Image.Dither.NONE)
    image.save(png, "PNG", optimize=True, dpi=(DPI, DPI))
    svg.write_text(to_svg(figure), encoding="utf-8")
    return png, svg
