"""Options that several commands share: types, groups of options, and parsing of their values."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_type_hints

import typer

from ..core.errors import InputError
from .complete import plants, several_controllers, symbols

if TYPE_CHECKING:
    from ..identification.preparation import Preparation

PlantArgument = Annotated[str, typer.Argument(help="Name of a plant, or the path of its TOML.", autocompletion=plants)]
PlantOption = Annotated[
    str, typer.Option("--plant", help="Name of a plant, or the path of its TOML.", autocompletion=plants)
]
OneModel = Literal["linear", "nonlinear"]
OneOrBoth = Literal["linear", "nonlinear", "both"]
Model = Annotated[OneModel, typer.Option(help="Parameter set of the plant.")]
NominalModel = Annotated[OneModel, typer.Option(help="Parameter set of the nominal plant.")]
Models = Annotated[OneOrBoth, typer.Option(help="Parameter set of the plant; both: those that it has.")]
Threshold = Annotated[
    float, typer.Option(help="Smallest relevant gap of a signal, relative to its standard deviation.")
]
Settings = Annotated[
    list[str],
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Override a value for this run: K_T=1.1, load.stiffness=50e3, M='20 kg'. Repeatable.",
        autocompletion=symbols,
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="Write the result's files to this folder.")]
Force = Annotated[bool, typer.Option("--force", help="Replace a result that is already in the folder.")]

#: What --zero and --align do with a channel, for the message about a value that is not a list of channels.
ZEROED = "it shifts each channel to its value at rest (P_0, x_0); --rest 0:0.5 gives the time of that rest"
ALIGNED = "it shifts each channel in time by its delay against the other channels"

#: Example of a KEY=VALUE pair, by option.
EXAMPLES = {
    "--set": "K_T=1.1",
    "--log-set": "'a.csv:K_T=1.1'",
    "--weight": "position='1 mm'",
    "--limit": "speed='350 rad/s'",
    "--spec": "tuning.Ms=1.5",
}


@dataclass(frozen=True)
class LogOptions:
    """Segment and preparation of the logs."""

    start: Annotated[float | None, typer.Option("--from", metavar="S", help="First second to use.")] = None
    stop: Annotated[float | None, typer.Option("--to", metavar="S", help="Last second to use.")] = None
    zero: Annotated[str, typer.Option(metavar="p1,p2", help="Correct the offset of these channels at rest.")] = ""
    rest: Annotated[
        str, typer.Option(metavar="S:S", help="Time of that rest, 0:0.5; by default before the first motion.")
    ] = ""
    resample: Annotated[float | None, typer.Option(metavar="HZ", help="Resample the logs to this rate.")] = None
    align: Annotated[str, typer.Option(metavar="CHANNELS", help="Correct the delay of these drives and outputs.")] = ""
    sample_time: Annotated[
        float | None, typer.Option(metavar="S", help="Sample time of the rows, instead of the time in the file.")
    ] = None

    def preparation(self) -> Preparation:
        """Raises InputError for a rest that is not two times, and for text that is not a list of channels."""
        from ..identification.preparation import Preparation

        channels = _channels(self.zero, "--zero", ZEROED), _channels(self.align, "--align", ALIGNED)
        return Preparation(
            self.start, self.stop, channels[0], _read_rest(self.rest), self.resample, channels[1], self.sample_time
        )


@dataclass(frozen=True)
class RunOptions:
    """Controllers, plant and design model that replace those of a scenario."""

    controller: Annotated[
        str | None,
        typer.Option(
            metavar="A[,B]",
            help="Controllers (names or files) instead of the scenario's.",
            autocompletion=several_controllers,
        ),
    ] = None
    plant: Annotated[
        str | None, typer.Option(help="Plant to check on, instead of the scenario's.", autocompletion=plants)
    ] = None
    design: Annotated[
        str | None,
        typer.Option(
            help="Plant whose linear model the design uses; by default the plant checked on.", autocompletion=plants
        ),
    ] = None
    settings: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Override a value of the plant checked on, for this run: K_T=1.1, load.stiffness=50e3. "
            "The linear prediction includes a load; the design model stays as in its file. Repeatable.",
            autocompletion=symbols,
        ),
    ] = field(default_factory=list)

    def controllers(self) -> list[str | None]:
        """Names of --controller; [None] for the scenario's own. Raises InputError for a text without a name."""
        if self.controller is None:
            return [None]
        if not (names := split_names(self.controller)):
            raise InputError(
                f"--controller {self.controller!r}: names no controller; expected names or files separated by commas, "
                "as in --controller pid_position,my/pid.toml"
            )
        return list(names)


def expand_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Replace each parameter of a command that is a dataclass by one typer option for each of its fields."""
    parameters: list[inspect.Parameter] = []
    groups: dict[str, Any] = {}
    for parameter in inspect.signature(command, eval_str=True).parameters.values():
        group = parameter.annotation
        if not is_dataclass(group):
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        groups[parameter.name] = group
        hints = get_type_hints(group, include_extras=True)
        for option in fields(group):
            default = option.default if option.default_factory is MISSING else option.default_factory()
            parameters.append(
                inspect.Parameter(
                    option.name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=hints[option.name]
                )
            )

    def expanded(**values: Any) -> None:
        for name, group in groups.items():
            values[name] = group(**{option.name: values.pop(option.name) for option in fields(group)})
        command(**values)

    expanded.__doc__ = command.__doc__
    expanded.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    expanded.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return expanded


def split_names(text: str) -> tuple[str, ...]:
    """Turn "p1, p2" into ("p1", "p2")."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _channels(text: str, option: str, does: str) -> tuple[str, ...]:
    found = split_names(text)
    for name in found:
        if not re.fullmatch(r"[A-Za-z]\w*", name):
            raise InputError(
                f"{option} {text!r}: {name!r} is not a channel name; expected names separated by commas, as in "
                f"{option} p1,p2: {does}"
            )
    return found


def _read_rest(text: str) -> tuple[float, float] | None:
    """Turn "0:0.5" into (0.0, 0.5); None for an empty text."""
    if not text:
        return None
    first, _, last = text.partition(":")
    try:
        return float(first), float(last)
    except ValueError:
        raise InputError(f"--rest {text!r}: expected two times in seconds, as in --rest 0:0.5") from None


LogSettings = Annotated[
    list[str],
    typer.Option(
        "--log-set",
        metavar="LOG:KEY=VALUE",
        help="Value of the plant for the logs of this name or path alone, which may have wildcards: 'kp100_*:kp=100'. "
        "Repeatable.",
    ),
]


def read_pairs(settings: list[str], option: str = "--set") -> dict[str, str]:
    """Turn ["K_T=1.1"] into {"K_T": "1.1"}. Raises InputError for a text without '=' and for a repeated key."""
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


def settings_by_log(texts: list[str], logs: Sequence[Path]) -> dict[Path, dict[str, str]]:
    """Turn ["kp100_*:kp=100"] into the settings of each log. Raises InputError for a text that fits no log."""
    found: dict[Path, list[str]] = {path: [] for path in logs}
    for text in texts:
        pattern, _, pair = text.rpartition(":")
        fitting = [path for path in logs if fnmatch(path.name, pattern) or fnmatch(path.as_posix(), pattern)]
        if not fitting:
            raise InputError(
                f"--log-set {text!r}: fits no log; expected LOG:KEY=VALUE with one of {', '.join(p.name for p in logs)}"
            )
        for path in fitting:
            found[path].append(pair)
    return {path: read_pairs(pairs, "--log-set") for path, pairs in found.items()}
