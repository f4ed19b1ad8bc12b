"""Pointers in compiled functions: to vectors, without reference counts, and to functions.

Passing an array from one compiled function to another updates a reference count, which in the engine's inner loop takes
up to a fifth of the run; passing a pointer costs nothing. Pointers are indexed like arrays, without bounds checks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast
from weakref import WeakKeyDictionary

from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

#: Contiguous arrays, as compiled loops take them.
VECTOR, TABLE, CUBE = (types.Array(types.float64, dimensions, "C") for dimensions in (1, 2, 3))
BYTE_TABLE, BYTE_CUBE = (types.Array(types.int8, dimensions, "C") for dimensions in (2, 3))
WORDS = types.Array(types.int64, 1, "C")


@intrinsic
def pointer(context: Any, array: Any) -> Any:
    """Address of the first element of a contiguous array."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return context.make_array(array)(context, builder, args[0]).data

    return types.CPointer(array.dtype)(array), generate


@intrinsic
def shifted(context: Any, start: Any, elements: Any) -> Any:
    """`start` advanced by this number of elements."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        size = context.get_abi_sizeof(context.get_data_type(start.dtype))
        return cgutils.pointer_add(builder, args[0], builder.mul(args[1], args[1].type(size)))

    return start(start, types.int64), generate


@intrinsic
def move(context: Any, target: Any, source: Any, elements: Any) -> Any:
    """Copy so many elements from one address to another; the two ranges may overlap."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        to, start, count = args
        size = context.get_abi_sizeof(context.get_data_type(source.dtype))
        cgutils.raw_memmove(builder, to, start, count, size)
        return context.get_dummy_value()

    return types.none(target, source, types.int64), generate


@intrinsic
def call(context: Any, address: Any, *arguments: Any) -> Any:
    """Call the function at an address (not 0), which takes these arguments and returns a double."""
    from llvmlite import ir

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        values = cgutils.unpack_tuple(builder, args[1])
        kind = ir.FunctionType(ir.DoubleType(), [value.type for value in values])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), values)

    return types.float64(types.int64, types.StarArgTuple(arguments)), generate


def address_of(function: Any, signature: Any) -> int:
    """Address of a function of numba.njit for this signature, compiling it if need be; for `function_at`.

    It is looked up once: Ctrl-C at a bad moment of a look-up would leave LLVM's lock closed to all other threads. A
    later `recompile` of the function changes nothing.

    Raises TypeError for another object and for another type of the result, numba's errors if it can't be compiled.
    """
    function = getattr(function, "__func__", function)  # that of a class attribute
    if not hasattr(function, "get_compile_result"):
        raise TypeError(f"{type(function).__name__} is no function of numba.njit")
    known = _addresses.setdefault(function, {})
    if signature not in known:
        if signature.args not in function.overloads and function._can_compile:
            function.compile(signature)
        found = function.get_compile_result(signature)
        if found.signature.return_type != signature.return_type:
            raise TypeError(f"it returns {found.signature.return_type}")
        known[signature] = int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))
    return known[signature]


#: Compiled function -> its signatures -> their addresses.
_addresses: WeakKeyDictionary[Any, dict[Any, int]] = WeakKeyDictionary()


def function_at(signature: Any) -> Callable[[int], Any]:
    """The compiled function with this signature at an address (not 0), as a value to call; it may raise.

    A function as an argument would be simpler, but numba looks up its address at every call, in Python: it takes
    0.1 ms, more than a controller's step, and Ctrl-C in it becomes a TypeError.
    """
    kind = types.FunctionType(signature)

    @intrinsic
    def at(context: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, called_as: Any, args: Any) -> Any:
            function = cgutils.create_struct_proxy(kind)(context, builder)
            function.jit_addr = builder.inttoptr(args[0], function.jit_addr.type)
            function.c_addr = function.py_addr = cgutils.get_null_value(function.c_addr.type)
            return function._getvalue()

        return kind(types.int64), generate

    return cast(Callable[[int], Any], at)
