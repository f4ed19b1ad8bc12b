"""Charts over time that a page shows live: which columns of a CSV file make which panel.

A chart knows names, units and looks; `live` reads the numbers. It is made from the result's JSON and the CSV beside it,
so that a page made later is the same page.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from .signals import ChannelDisplay
from .style import BLACK, BLUE, GREEN, GREY, PURPLE, SKY, VERMILION

if TYPE_CHECKING:
    from .page import Picture

Span = tuple[float, float]


class Look(NamedTuple):
    """Colour, dashes [px] and width [px] of a line."""

    colour: str
    dash: tuple[int, ...] = ()
    width: float = 1.5


#: Role of a line -> look, as far as possible that of the printed figures. Lines differ without colour
#: by dashes and width.
LOOKS = {
    "drive": Look(BLUE, (), 1.0),
    "reference": Look(BLACK, (8, 4), 1.2),
    "measured": Look(SKY, (), 3.0),
    "linear": Look("#222222", (6, 2, 1, 2), 1.2),
    "nonlinear": Look(VERMILION),
    "before": Look("#444444", (4, 2), 1.2),
    "after": Look(VERMILION),
}
#: Colours of several controllers, apart for colour-blind readers.
PALETTE = (VERMILION, BLUE, GREEN, PURPLE, "#b58900", SKY, GREY)


@dataclass(frozen=True)
class Line:
    """A column of a chart's file.

    switches: keys of the switches that must all be on for the line to be shown; none for a line that always is.
    bounded: the line may leave its panel, as a run far from the measurement does. file: other than that of the chart.
    """

    column: str
    label: str
    look: Look
    switches: tuple[str, ...] = ()
    stepped: bool = False
    bounded: bool = False
    file: str = ""


@dataclass(frozen=True)
class ChartPanel:
    """A panel: its name, display unit and lines."""

    how: ChannelDisplay
    lines: Sequence[Line]


@dataclass(frozen=True)
class Switch:
    """A switch of a chart; look: None for a switch that stands for lines of several looks."""

    key: str
    label: str
    look: Look | None = None
    on: bool = True


@dataclass(frozen=True)
class Strip:
    """Bars below the panels: the times when a column is (or is not) zero, or is beyond limits.

    still: true while the column is zero. low, high: true while the column is outside them, in the column's unit.
    """

    label: str
    column: str
    colour: str
    still: bool = False
    low: float = float("-inf")
    high: float = float("inf")
    file: str = ""


@dataclass(frozen=True)
class RegimeCurve:
    """What an unknown input depends on; a click on a point marks its samples.

    across, up: names with units of the axes; unit: of `up`. points: variable, mean and standard deviation of each bin,
    display units.
    column: of the number of the bin in `file`, 1 for the first; 0 is in none.
    """

    label: str
    across: str
    up: str
    points: Sequence[tuple[float, float, float]]
    column: str
    file: str
    unit: str = ""


@dataclass(frozen=True, eq=False)
class Chart:
    """A live chart, and the figures that stand in for it in print and without scripts.

    file: CSV beside the JSON, with the column t [s]. shaded: held-out parts [s]. swap: label and the keys of two
    switches, of which one button turns one on and the other off.
    """

    heading: str
    file: str
    panels: Sequence[ChartPanel]
    pictures: Sequence[Picture] = ()
    switches: Sequence[Switch] = ()
    strips: Sequence[Strip] = ()
    shaded: Sequence[Span] = ()
    regimes: Sequence[RegimeCurve] = ()
    swap: tuple[str, str, str] | None = None
    caption: str = ""

    @property
    def lines(self) -> list[Line]:
        return [line for panel in self.panels for line in panel.lines]

    @property
    def texts(self) -> list[str]:
        """Its texts, for `page.check`."""
        own = [self.heading, self.file, self.caption, *(self.swap or ())]
        own += [text for each in self.switches for text in (each.key, each.label)]
        own += [text for each in self.lines for text in (each.label, each.column, each.file)]
        return own + [text for each in self.regimes for text in (each.label, each.across, each.up, each.unit)]


def columns_of(path: Path) -> list[str]:
    """The header of a CSV file; empty if there is none that can be read."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return next(csv.reader(file), [])
    except (OSError, ValueError, csv.Error):
        return []
