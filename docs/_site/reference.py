"""Reference pages generated from the code at each build: commands, TOML keys, effects, friction, metrics, API."""

from __future__ import annotations

from page_api import api, api_names
from page_catalogues import effects, friction, metrics
from page_commands import commands
from page_forms import controllers, plants, scenarios


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
