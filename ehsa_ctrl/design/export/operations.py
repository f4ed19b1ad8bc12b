"""Operations of one sample of a controller, counted while its Python functions run."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from ..controller import SampledController
from ..stages.pipeline import pipeline

#: Operations by name, and the methods of float that perform them.
METHODS = {
    "additions": ("__add__", "__radd__", "__sub__", "__rsub__", "__neg__"),
    "multiplications": ("__mul__", "__rmul__"),
    "divisions": ("__truediv__", "__rtruediv__", "__mod__", "__rmod__"),
    "comparisons": ("__lt__", "__le__", "__gt__", "__ge__", "__eq__", "__ne__"),
}


class CountedFloat(float):
    """A float that counts its operations in `counts`. Functions of math are not counted."""

    counts: Counter[str] = Counter()
    __hash__ = float.__hash__


def _counting(method: str, kind: str) -> Any:
    plain = getattr(float, method)

    def operation(self: CountedFloat, *others: Any) -> Any:
        CountedFloat.counts[kind] += 1
        result = plain(self, *map(float, others))
        return result if kind == "comparisons" else CountedFloat(result)

    return operation


for _kind, _methods in METHODS.items():
    for _method in _methods:
        setattr(CountedFloat, _method, _counting(_method, _kind))


def worst_operations(
    controller: SampledController, reference: np.ndarray, measured: np.ndarray, only: int | None = None
) -> dict[str, int]:
    """Floating-point operations of the costliest sample of a run, by kind and as `flops`, which omits comparisons.

    controller: of `embedded_controller`. reference (N, 3 or 4), measured (N, 5) with nan for lost readings: as for
    `export_controller`. only: the costliest sample where it is known; counting takes ten times as long as running.
    """

    def counted(values: np.ndarray) -> np.ndarray:
        return np.array([CountedFloat(value) for value in values], dtype=object)

    memory, worst = controller.initial_memory(), {"flops": -1}
    settings = counted(controller.settings())
    if only is None:
        memory = counted(memory)
    for k, (r, y) in enumerate(zip(reference, measured, strict=True)):
        if only is not None and k < only:
            controller.step(r, y, memory)
            continue
        if k == only:
            memory = counted(memory)
        CountedFloat.counts.clear()
        pipeline(counted(r), counted(y), memory, settings, controller.law.function)
        counts = {kind: CountedFloat.counts[kind] for kind in METHODS}
        flops = sum(counts.values()) - counts["comparisons"]
        if flops > worst["flops"]:
            worst = {"flops": flops, **counts}
        if k == only:
            break
    return worst
