"""The page of commands: arguments, options and examples, from the program."""

from __future__ import annotations

import inspect
import re
import typing
from collections.abc import Iterator
from typing import Any

import typer
from words import cell

from ehsa_ctrl.cli.main import app


def all_commands() -> dict[str, Any]:
    """Every command by the words after `ehsa-ctrl`, including those of groups."""

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
        "Generated from the program. Every command has `--help`. Exit status: 0 done; 1 it ran, but a "
        "scenario's limit or baseline failed; 2 wrong input, explained in one sentence.",
        "",
        "| command | what it does |",
        "|---|---|",
        *(f"| [`{name}`](#{_anchor(name)}) | {cell(_about(command)[0])} |" for name, command in listed.items()),
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
    """First sentence, further paragraphs, examples one per line."""
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
    """One row: spelling, value, meaning."""
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
    return f"| {spelled} | {takes} | {cell(means)} |"


def _takes(parameter: Any) -> str:
    annotation = parameter.type_descriptor.annotation
    names = {"str": "text", "int": "whole number", "float": "number", "Path": "file"}
    inner = [part for part in (typing.get_args(annotation) or (annotation,)) if part is not type(None)]
    return names.get(getattr(inner[0], "__name__", ""), "")
