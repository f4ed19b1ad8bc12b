r"""Formulas as SVG, drawn at build time: pages need no script, no font and no network.

Formulas are written as $...$ and $$...$$. `pymdownx.arithmatex` finds them and ziamath draws them; `\tag{6}` adds the
equation's number. The formula's source stays in the page for search and screen readers.
"""

from __future__ import annotations

import html
import re
from functools import cache

import ziamath

FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)
TAG = re.compile(r"\\tag\{([^}]*)\}")
#: Size of the drawn text; lengths in the page are in units of the text around it.
EM = 16.0
#: Scale that matches formulas with sans serif text.
LARGER = 1.06

ziamath.config.svg2 = False
ziamath.config.precision = 1


def render(page: str) -> str:
    """A page's HTML with every formula that arithmatex marked drawn."""
    return FORMULA.sub(_formula, page)


def _formula(match: re.Match[str]) -> str:
    text = html.unescape(match[3]).strip()
    if match[2] == "(":
        return draw(text, inline=True)
    tag = TAG.search(text)
    formula = draw(TAG.sub("", text).strip(), inline=False)
    number = f'<span class="equation-number" id="eq-{tag[1]}">({tag[1]})</span>' if tag else ""
    return f'<div class="equation">{formula}{number}</div>'


@cache
def draw(text: str, *, inline: bool) -> str:
    """One formula as an SVG in the text's colour, on the text's line."""
    drawn = ziamath.Latex(text, size=EM * LARGER, color="currentColor", inline=inline)
    picture = drawn.svg()
    width, height = (float(re.search(rf'{side}="([\d.]+)"', picture)[1]) for side in ("width", "height"))  # type: ignore[index]
    top = float(re.search(r'viewBox="\S+ (\S+)', picture)[1])  # type: ignore[index]
    style = f"width:{width / EM:.3f}em;height:{height / EM:.3f}em"
    if inline:
        style += f";vertical-align:{-(height + top) / EM:.3f}em"
    picture = re.sub(r' xmlns:xlink="[^"]*"| width="[\d.]+"| height="[\d.]+"', "", picture, count=3)
    said = html.escape(text, quote=True)
    return picture.replace("<svg", f'<svg class="formula" role="img" aria-label="{said}" style="{style}"', 1)
