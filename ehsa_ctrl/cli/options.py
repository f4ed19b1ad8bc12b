"""Options that several commands share, and how their values are read."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import InputError
from .complete import symbols

if TYPE_CHECKING:
    from ..identification.preparation import Preparation

Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Believe another value in this run: K_T=1.1, load.stiffness=50e3, M='20 kg'. Repeatable.",
        autocompletion=symbols,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write the result's files to this folder.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a result that is already in the folder.")]

#: What the options do with the channels that they name, for who gives more than names.
ZEROED = "each is shifted to what the plant has at rest (P_0, x_0), and --rest 0:0.5 says where that rest is"
ALIGNED = "each is moved by its delay against the simulation"

#: A pair for each option that takes them, as a message shows it.
EXAMPLES = {
    "--set": "K_T=1.1",
    "--weight": "position='1 mm'",
    "--limit": "speed='350 rad/s'",
    "--spec": "tuning.Ms=1.5",
}


First = Annotated[float | None, typer.Option("--from", metavar="S", help="First second to use.")]
Last = Annotated[float | None, typer.Option("--to", metavar="S", help="Last second to use.")]
Zero = Annotated[str, typer.Option(metavar="p1,p2", help="Set these channels' zero from the rest.")]
Rest = Annotated[str, typer.Option(metavar="S:S", help="That rest, e.g. 0:0.5; else it is looked for.")]
Resample = Annotated[float | None, typer.Option(metavar="HZ", help="Bring the logs to this rate.")]
Align = Annotated[str, typer.Option(metavar="CHANNELS", help="Move these channels by their delay.")]


def names(text: str) -> tuple[str, ...]:
    """Turn "p1, p2" into ("p1", "p2")."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def read_preparation(
    first: float | None, last: float | None, zero: str, rest: str, resample: float | None, align: str
) -> Preparation:
    """What the six options above ask for. Raises InputError for a rest that is not two times."""
    from ..identification.preparation import Preparation

    channels = (_channels(zero, "--zero", ZEROED), _channels(align, "--align", ALIGNED))
    return Preparation(first, last, channels[0], _read_rest(rest), resample, channels[1])


def _channels(text: str, option: str, does: str) -> tuple[str, ...]:
    """Names of channels. Raises InputError for what can't be one."""
    found = names(text)
    for name in found:
        if not re.fullmatch(r"[A-Za-z]\w*", name):
            raise InputError(
                f"{option} {text!r}: {name!r} is no name of a channel; expected names separated by commas and nothing "
                f"else, as in {option} p1,p2: {does}"
            )
    return found


def _read_rest(text: str) -> tuple[float, float] | None:
    """Turn "0:0.5" into (0.0, 0.5); None for nothing."""
    if not text:
        return None
    first, _, last = text.partition(":")
    try:
        return float(first), float(last)
    except ValueError:
        raise InputError(f"--rest {text!r}: expected two times in seconds, as 0:0.5") from None


def read_pairs(settings: list[str], option: str = "--set") -> dict[str, str]:
    """Turn ["K_T=1.1"] into {"K_T": "1.1"}. Raises InputError for text without '=' and for a key given twice."""
    pairs: dict[str, str] = {}
    for text in settings:
        key, equals, value = text.partition("=")
        key = key.strip()
        if not equals or not key or not value.strip():
            raise InputError(f"{option} {text!r}: expected KEY=VALUE, as in {option} {EXAMPLES[option]}")
        if key in pairs:
            raise InputError(f"{option} {key} is given twice; give it once")
        pairs[key] = value.strip()
    return pairs
