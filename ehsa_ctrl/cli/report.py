"""`ehsa-ctrl report`: one page of all results in a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .options import Force, Json
from .output import to_json, warn


def command(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Folder that commands wrote to with --out.")],
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="Write overview.html to this folder instead.")
    ] = None,
    as_json: Json = False,
    force: Force = False,
) -> None:
    """Build one self-contained page, overview.html, from all results in a folder and its subfolders.

    It uses the JSON files and figures that are there; nothing is recomputed.

    Examples: ehsa-ctrl report results · ehsa-ctrl report demo --force · ehsa-ctrl report results --out to_send
    """
    from ..core.result_folder import ResultFolder
    from ..report.results import FILE, results_in, write_overview

    place = out or folder
    results, wrong = results_in(folder, place)
    result = ResultFolder(place, "report", force).check(FILE)
    for sentence in wrong:
        warn(f"skipped: {sentence}")
    with result.draft() as draft:
        write_overview(results, draft, folder.resolve().name)
    page = place / FILE
    if as_json:
        stated = [
            {
                "kind": each.kind.word,
                "file": each.folder / each.kind.name,
                "title": each.page.title,
                "good": not each.doubtful,
                "failed": each.failed,
                "sentences": [words for words, _ in each.page.sentences],
            }
            for each in results
        ]
        print(to_json({"page": page, "results": stated, "left_out": wrong}))
        return
    for each in results:
        mark = "FAIL " if each.failed else "check" if each.doubtful else "ok   "
        print(f"{mark}  {each.folder / each.kind.name}: {each.page.title}")
    print(f"written to {page}")
