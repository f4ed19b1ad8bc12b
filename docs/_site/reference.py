"""Reference pages written from the code at each build: commands, keys of TOML files, effects, friction, metrics, API.

What is said here is said in the code; a page can't go stale. `pages()` gives the Markdown of each.
"""

from __future__ import annotations

import importlib
import inspect
import re
import typing
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, Literal

import typer
from pydantic import BaseModel

import ehsa_ctrl
from ehsa_ctrl.cli.main import app
from ehsa_ctrl.core.described import Key, keys, summary
from ehsa_ctrl.design.kinds import CONTROLLER_KINDS, ControllerFile
from ehsa_ctrl.physics.effects import EFFECTS
from ehsa_ctrl.physics.effects._effect import PLACES
from ehsa_ctrl.physics.friction import LAWS, LETTERS
from ehsa_ctrl.plant.file import CHANNEL_UNITS, LIMIT_UNITS, LOAD_LETTERS, PlantFile
from ehsa_ctrl.plant.systems import SYSTEMS
from ehsa_ctrl.scenario.definition import ScenarioFile
from ehsa_ctrl.scenario.metrics import METRICS

PACKAGE = Path(ehsa_ctrl.__file__).parent

#: The API's pages in the order in which a reader meets them: title, what it is about, names.
API = {
    "plants": ("Plants", "A plant, its structure and its linear models.", (
        "load_plant", "Plant", "Structure", "plants", "four_state", "three_state", "linearise", "to_iosystem",
        "conditions", "draw", "drawn_models",
    )),
    "simulation": ("Simulation", "One run, many runs, derivatives, and the virtual bench.", (
        "simulate", "simulate_batch", "sensitivities", "simulate_reference", "excitation", "record", "slip_quantum",
        "shortest_time", "SteppedRun", "export_fmu",
    )),
    "logs": ("Logs and identification", "From a log to parameters with their uncertainty.", (
        "read_log", "read_plant_log", "check_log", "Preparation", "replay", "fit_percent", "identify", "write_plant",
        "profile", "forecast", "design_experiment",
    )),
    "control": ("Controllers and their analysis", "Designed on linear models, in the frequency domain.", (
        "controllers", "load_controller", "analyse", "analyse_loop", "robust_margins", "review", "Known",
    )),
    "scenarios": ("Closed loops and scenarios", "Controllers on the plant with friction.", (
        "scenarios", "load_scenario", "run", "run_closed_loop", "monte_carlo", "known_of",
    )),
    "diagnosis": ("Diagnosis", "Where rig and simulation differ, and why.", (
        "diagnose", "Diagnosis", "diagnose_many", "what_changed",
    )),
    "errors": ("Errors", "What is raised, and when.", ("EhsaError", "InputError", "SimulationError")),
}  # fmt: skip

#: What functions give back, shown below the functions of a page.
RESULTS = {
    "simulation": ("simulation.trajectory.Trajectory",),
    "logs": ("core.log.Log", "identification.identification.Identification", "identification.uncertainty.Estimate"),
    "control": ("design.controller.SampledController",),
    "scenarios": ("scenario.result.ScenarioResult", "simulation.closed_loop.ClosedLoop"),
    "diagnosis": ("diagnosis.diagnosis.Cause",),
}


def pages() -> dict[str, str]:
    """Path of each generated page, relative to the documents' folder, and its Markdown."""
    return {
        "reference/commands.md": commands(),
        "reference/plants.md": plants(),
        "reference/controllers.md": controllers(),
        "reference/scenarios.md": scenarios(),
        "reference/effects.md": effects(),
        "reference/friction.md": friction(),
        "reference/metrics.md": metrics(),
        **{f"reference/api/{name}.md": api(name) for name in api_names()},
    }


# ---------------------------------------------------------------------------------------------------------- commands


def all_commands() -> dict[str, Any]:
    """Every command by what is typed after `ehsa-ctrl`, those of groups included."""

    def walk(group: Any, before: str) -> Iterator[tuple[str, Any]]:
        for name, command in group.commands.items():
            if getattr(command, "commands", None):
                yield from walk(command, f"{before}{name} ")
            elif not command.hidden:
                yield before + name, command

    return dict(walk(typer.main.get_command(app), ""))


def commands() -> str:
    """Every command with its arguments, options and examples."""
    listed = all_commands()
    lines = [
        "# Commands",
        "",
        "Written from the program itself. Every command answers `--help`. Exit status: 0 done; 1 it ran, but a "
        "scenario's limit or baseline was not kept; 2 the input was wrong, said in one sentence.",
        "",
        "| command | what it does |",
        "|---|---|",
        *(f"| [`{name}`](#{_anchor(name)}) | {_cell(_about(command)[0])} |" for name, command in listed.items()),
    ]
    for name, command in listed.items():
        about, more, examples = _about(command)
        lines += ["", f"## ehsa-ctrl {name} {{ #{_anchor(name)} }}", "", about, *(f"\n{text}" for text in more)]
        if examples:
            lines += ["", "```sh", *examples, "```"]
        rows = [_option(parameter) for parameter in command.params if not parameter.hidden]
        lines += ["", "| option | value | meaning |", "|---|---|---|", *rows]
    return "\n".join(lines) + "\n"


def _anchor(name: str) -> str:
    return name.replace(" ", "-")


def _about(command: Any) -> tuple[str, list[str], list[str]]:
    """First sentence, further paragraphs, examples one a line."""
    paragraphs = [" ".join(part.split()) for part in re.split(r"\n\s*\n|\x08", inspect.cleandoc(command.help or ""))]
    paragraphs = [part for part in paragraphs if part]
    examples: list[str] = []
    text = []
    for part in paragraphs:
        if part.startswith("Example"):
            part = part.partition(":")[2]
            examples += [item.strip() for item in re.split(r"·|(?<!^)(?=\behsa-ctrl [a-z])", part) if item.strip()]
        else:
            text.append(part)
    return (text[0] if text else ""), text[1:], examples


def _option(parameter: Any) -> str:
    """One row: how it is written, what it takes, what it means."""
    if parameter.opts[0].startswith("-"):
        spelled = ", ".join(f"`{word}`" for word in [*parameter.opts, *parameter.secondary_opts])
    else:
        spelled = f"`{parameter.name}{'...' if parameter.nargs == -1 else ''}`"
    if getattr(parameter, "is_flag", False):
        takes = ""
    elif parameter.metavar:
        takes = f"`{parameter.metavar}`"
    else:
        takes = _takes(parameter)
    means = parameter.help or ""
    if parameter.required:
        means += " *Required.*"
    elif parameter.default not in (None, "", False, [], ()) and not getattr(parameter, "is_flag", False):
        means += f" Default: `{parameter.default}`."
    return f"| {spelled} | {takes} | {_cell(means)} |"


def _takes(parameter: Any) -> str:
    annotation = parameter.type_descriptor.annotation
    names = {"str": "text", "int": "whole number", "float": "number", "Path": "file"}
    inner = [part for part in (typing.get_args(annotation) or (annotation,)) if part is not type(None)]
    return names.get(getattr(inner[0], "__name__", ""), "")


# --------------------------------------------------------------------------------------------------------------- TOML


def plants() -> str:
    """Keys of a plant's TOML, its letters, limits and channels."""
    lines = [
        "# A plant's TOML",
        "",
        "In `plants/`, or anywhere if you give the path. An unknown key is a mistake and is said to be one. Numbers "
        "have the form of [`[parameters]`](#parameters) everywhere: in `[limits]`, `[load]`, `[sampling]` and "
        "`[sensors.CHANNEL]` too.",
        *form(PlantFile, ""),
        "",
        "## Systems and their letters",
        "",
        "`system` selects the equations. The letters of a system are what `[parameters]`, `[linear.parameters]` and "
        "`[nonlinear.parameters]` may hold; friction adds its own ([Friction laws](friction.md)), and so do effects "
        "([Effects](effects.md)).",
    ]
    for system in SYSTEMS.values():
        lines += ["", f"### {system.name}", "", f"{_sentence(system.title)} States: "]
        lines[-1] += ", ".join(f"`{state.name}` [{state.unit}]" for state in system.states) + "."
        lines += ["", "| letter | unit | meaning |", "|---|---|---|"]
        lines += [f"| `{kind.name}` | {kind.unit} | {_cell(kind.meaning)} |" for kind in system.parameters]
    lines += ["", "## Limits", "", "| key | unit |", "|---|---|"]
    lines += [f"| `{name}` | {unit} |" for name, unit in LIMIT_UNITS.items()]
    lines += ["", "## Channels", "", "Of `[sensors]` and `[log]`, beside `t`.", "", "| channel | unit |", "|---|---|"]
    lines += [f"| `{name}` | {unit} |" for name, unit in CHANNEL_UNITS.items()]
    lines += ["", "## Load", "", "On the command line `--set load.stiffness=50e3`.", ""]
    lines += ["| key | letter |", "|---|---|", *(f"| `{word}` | `{letter}` |" for word, letter in LOAD_LETTERS.items())]
    return "\n".join(lines) + "\n"


def controllers() -> str:
    """Keys of a controller's TOML, a section a kind."""
    lines = [
        "# A controller's TOML",
        "",
        "In `controllers/`, or anywhere if you give the path. `kind` selects the feedback law and with it the keys; "
        "the stages `[trajectory]`, `[feedforward]`, `[rest]` and `[dither]` go with every kind.",
    ]
    seen: set[Any] = set()
    lines += ["", "## Every kind", *form(ControllerFile, "", level=3, title="every", seen=seen)]
    shared = {key.name for key in keys(ControllerFile)} - {"kind"}
    for kind in CONTROLLER_KINDS.values():
        own = form(kind.file, "", level=3, title=kind.name, seen=set(seen), without=shared)
        lines += ["", f"## {kind.name}", "", _sentence(kind.summary), *own]
    return "\n".join(lines) + "\n"


def scenarios() -> str:
    """Keys of a scenario's TOML."""
    lines = [
        "# A scenario's TOML",
        "",
        "In `scenarios/`, or anywhere if you give the path. What may stand under `[limits]` is in "
        "[Metrics](metrics.md).",
        *form(ScenarioFile, ""),
    ]
    return "\n".join(lines) + "\n"


def form(
    kind: type[BaseModel],
    table: str,
    level: int = 2,
    title: str = "",
    seen: set[Any] | None = None,
    without: Collection[str] = (),
) -> list[str]:
    """A table of the keys of one form but those in `without`, and below it those of the tables in it.

    title: first word of the anchors. seen: forms that need not be told again; those that are told here are added.
    """
    seen = set() if seen is None else seen
    seen.add(kind)
    known = [key for key in keys(kind) if key.name not in without]
    lines = []
    if table:
        # A nested table's own anchor, so that the same word in two kinds does not clash.
        anchor = "-".join(re.findall(r"\w+", f"{title} {table} {_word(kind)}")).lower()
        lines += ["", f"{'#' * level} {_heading(kind, table)} {{ #{anchor} }}"]
        said = re.sub(r"^.{0,40}?\[+[\w.]+\]+[:.]?\s*", "", summary(kind))
        if said:
            lines += ["", _sentence(said)]
    lines += ["", "| key | value | default | meaning |", "|---|---|---|---|"]
    lines += [f"| `{key.name}` | {_value(key, kind)} | {_default(key)} | {_cell(key.meaning)} |" for key in known]
    for key in known:
        for inner in key.forms or _mapped(kind, key):
            if inner not in seen:
                path = f"{table}.{key.name}" if table else key.name
                deeper = form(inner, f"[{path}]" if key.many else path, level + (1 if table else 0), title, seen)
                lines += deeper
    return lines


def _heading(kind: type[BaseModel], table: str) -> str:
    """The table as it is written; where a key chooses the form, with that."""
    word = _word(kind)
    return f"`[{table}]`" + (f" of kind `{word}`" if word else "")


def _word(kind: type[BaseModel]) -> str:
    """The word by which a key `kind` chooses this form; empty where none does."""
    field = kind.model_fields.get("kind")
    return str(typing.get_args(field.annotation)[0]) if field and typing.get_origin(field.annotation) is Literal else ""


def _mapped(kind: type[BaseModel], key: Key) -> tuple[type[BaseModel], ...]:
    """The form of the values of a key that is a table of names, as [parameters] is."""
    field = next(f for name, f in kind.model_fields.items() if (f.alias or name) == key.name)
    arguments = typing.get_args(field.annotation)
    if typing.get_origin(field.annotation) is dict and isinstance(arguments[1], type):
        return (arguments[1],) if issubclass(arguments[1], BaseModel) else ()
    return ()


def _value(key: Key, kind: type[BaseModel]) -> str:
    """What a key takes, in words."""
    if key.choices:
        return " or ".join(f"`{word}`" for word in key.choices)
    if key.unit is not None:
        field = next(f for name, f in kind.model_fields.items() if (f.alias or name) == key.name)
        several = "list of " if "list[" in str(field.annotation) else ""
        return several + ("number" if key.unit in ("1", "fraction") else f'`"... {key.unit}"`')
    if key.forms:
        return "tables" if key.many else "table"
    field = next(f for name, f in kind.model_fields.items() if (f.alias or name) == key.name)
    return _plain(field.annotation)


def _plain(annotation: Any) -> str:
    if typing.get_origin(annotation) is dict:
        names = typing.get_args(annotation)[0]
        words = typing.get_args(names) if typing.get_origin(names) is Literal else ()
        return "table of " + (", ".join(f"`{word}`" for word in words) if words else "names")
    inner = [part for part in typing.get_args(annotation) if part is not type(None)]
    if type(None) in typing.get_args(annotation) and len(inner) == 1:
        return _plain(inner[0])
    if typing.get_origin(annotation) is list:
        return f"list of {_plain(inner[0])}".replace("number", "numbers")
    if typing.get_origin(annotation) is tuple:
        return f"[{', '.join(_plain(part) for part in inner)}]"
    text = str(annotation)
    for word, meaning in (("bool", "`true` or `false`"), ("int", "whole number"), ("float", "number"), ("str", "text")):
        if annotation.__class__ is type and annotation.__name__ == word:
            return meaning
        if re.search(rf"\b{word}\b", text):
            return meaning
    return ""


def _default(key: Key) -> str:
    if key.required:
        return "required"
    if key.default is None or key.default in ("", [], {}) or isinstance(key.default, BaseModel):
        return ""
    if isinstance(key.default, bool):
        return f"`{str(key.default).lower()}`"
    if isinstance(key.default, float):
        unit = f" {key.unit}" if key.unit not in (None, "1", "fraction") else ""
        return "none" if key.default in (float("inf"), float("-inf")) else f"`{key.default:.4g}{unit}`"
    return f"`{key.default}`" if isinstance(key.default, str | int) else ""


# ------------------------------------------------------------------------------------------- effects, friction, metrics


def effects() -> str:
    """The catalogue of effects, place by place, with equations as they stand in the code."""
    lines = [
        "# Effects",
        "",
        f"What a real rig does that (12) does not: {len(EFFECTS)} effects, off by default. At its neutral value an "
        "effect changes no bit of a simulation. *In a plant* says how it is switched on, *in a log* what shows it.",
    ]
    for place in PLACES:
        here = {name: effect for name, effect in EFFECTS.items() if effect.place == place}
        lines += ["", f"## {place.capitalize()}"]
        for name, effect in here.items():
            lines += ["", f"### {name}", "", _sentence(effect.summary)]
            detail = _equations(name)
            lines += ["", *detail] if detail else []
            lines += ["", f"*In a log:* {effect.fingerprint}.", "", f"*In a plant:* {_switched_on(effect)}"]
            lines += ["", f"*Source:* {effect.source}."] if effect.source else []
            if effect.parameters:
                lines += [
                    "",
                    "| parameter | unit | meaning | neutral | typical | bounds |",
                    "|---|---|---|---|---|---|",
                ]
                lines += [
                    f"| `{p.name}` | {p.unit} | {_cell(p.meaning)} | {p.neutral:g} | {p.typical:g} ({p.source}) "
                    f"| {p.lower:g} to {p.upper:g} |"
                    for p in effect.parameters
                ]
    return "\n".join(lines) + "\n"


def _equations(name: str) -> list[str]:
    """What the effect's file says of itself: its text beyond the first line, and each equation's line."""
    module = next(
        module
        for path in (PACKAGE / "physics" / "effects").glob("[!_]*.py")
        if (module := importlib.import_module(f"ehsa_ctrl.physics.effects.{path.stem}")).effect.name == name
    )
    body = inspect.cleandoc(module.__doc__ or "").partition("\n")[2].strip()
    lines = [body, ""] if body else []
    effect = module.effect
    for signal, function in {**effect.changes, **effect.adds}.items():
        about = " ".join(inspect.cleandoc(function.__doc__ or "").split())
        lines.append(f"- `{signal}`: {about}")
    return lines


def _switched_on(effect: Any) -> str:
    if effect.wired:
        return f'`effects = ["{effect.name}"]` in `[linear]` or `[nonlinear]`' + (
            ", parameters among the others." if effect.parameters else "."
        )
    if effect.letters:
        return "another value of " + ", ".join(f"`{letter}`" for letter in effect.letters) + "."
    if effect.sensor is not None:
        return f"`{effect.sensor}` in `[sensors.CHANNEL]`."
    return f'`rod_friction = "{effect.rod_friction}"`.'


def friction() -> str:
    """The friction laws and their letters."""
    lines = [
        "# Friction laws",
        "",
        "By name for shaft and rod: `shaft_friction` and `rod_friction` of a plant's model. "
        "[How to choose](../choose.md#which-friction-law).",
        "",
        "| law | | sticks | letters |",
        "|---|---|---|---|",
    ]
    for law in LAWS.values():
        letters = ", ".join(f"`{letter}`" for letter in law.letters) or "none"
        lines.append(
            f"| [`{law.name}`](#{law.name}) | {_cell(law.summary)} | {'yes' if law.sticks else 'no'} | {letters} |"
        )
    lines += [
        "",
        "`A`, `B`, `C`, `tau` become `A_FM` ... `tau_FM` on the shaft and `A_FR` ... `tau_FR` on the rod; the others "
        "get `_FM` or `_FR` likewise.",
        "",
        "| letter | meaning | unit on the shaft | unit on the rod |",
        "|---|---|---|---|",
    ]
    for letter, (unit, meaning) in LETTERS.items():
        shaft, rod = unit.format(effort="N m", length="rad"), unit.format(effort="N", length="m")
        lines.append(f"| `{letter}` | {meaning} | {shaft} | {rod} |")
    for law in LAWS.values():
        text = inspect.cleandoc(inspect.getmodule(law.effort).__doc__ or "")
        equations = [law.effort.__doc__ or "", *([law.state_rate.__doc__ or ""] if law.state_rate else [])]
        lines += ["", f"## {law.name}", "", text, ""]
        lines += [f"- {' '.join(inspect.cleandoc(equation).split())}" for equation in equations if equation]
    return "\n".join(lines) + "\n"


def metrics() -> str:
    """What a scenario can put limits on."""
    lines = [
        "# Metrics",
        "",
        "Of a closed loop; each can stand under a scenario's `[limits]` with `min`, `max` or both. A regression looks "
        "at differences beyond the last column and a share of the recorded value (`[baseline]`).",
        "",
        "| metric | shown in | meaning | least difference |",
        "|---|---|---|---|",
    ]
    for name, metric in METRICS.items():
        shown = "" if metric.shown == "1" else metric.shown
        lines.append(f"| `{name}` | {shown} | {_cell(metric.meaning)} | {metric.read(metric.floor)} |")
    return "\n".join(lines) + "\n"


# ---------------------------------------------------------------------------------------------------------------- API


def api_names() -> dict[str, list[str]]:
    """Page -> public names; one that the table does not place stands with the others of its package."""
    placed = {page: list(names) for page, (_, _, names) in API.items()}
    homes = {name: page for page, names in placed.items() for name in names}
    packages: dict[str, str] = {}
    for name, page in homes.items():
        packages.setdefault(ehsa_ctrl._WHERE[name].partition(".")[0], page)
    for name in ehsa_ctrl.__all__:
        if name not in homes and name != "__version__":
            placed[packages.get(ehsa_ctrl._WHERE[name].partition(".")[0], "scenarios")].append(name)
    return placed


def api(page: str) -> str:
    """Directives for mkdocstrings, one a name."""
    title, about, _ = API[page]
    lines = [f"# {title}", "", about, "", "All of these are names of `ehsa_ctrl` itself: `import ehsa_ctrl as e`."]
    for name in api_names()[page]:
        module = ehsa_ctrl._WHERE[name]
        if module == "core.catalogue":
            lines += ["", f"## `{name}` {{ #{name} }}", "", _catalogue(name)]
        else:
            lines += ["", f"::: ehsa_ctrl.{module}.{name}"]
    lines += [line for path in RESULTS.get(page, ()) for line in ("", f"::: ehsa_ctrl.{path}")]
    return "\n".join(lines) + "\n"


def _catalogue(name: str) -> str:
    return (
        f"The {name} that there are: those of a folder `{name}/` beside your script first, then those shipped. "
        f"A mapping with attributes, `e.{name}.NAME` or `e.{name}['NAME']`; printed, it is a table.\n\n"
        + "\n".join(f"- `{entry}`: {title}" for entry, title in getattr(ehsa_ctrl, name).titles().items())
    )


# -------------------------------------------------------------------------------------------------------------- words


def _cell(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ").strip()


def _sentence(text: str) -> str:
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith(".") else ".")
