"""How results show themselves in a notebook."""

from __future__ import annotations


class ShownAsText:
    """A result whose text is what a notebook shows, in letters of equal width, so that its tables stay tables."""

    def _repr_html_(self) -> str:
        import html

        return f"<pre>{html.escape(str(self))}</pre>"
