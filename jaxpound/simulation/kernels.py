"""Programs that XLA compiles as one kernel on CPUs.

There XLA starts each small operation of a program on its own, which takes longer than the
operation. It compiles calls that bear an attribute as one kernel: that by which its own pass for
small loops (``SmallWhileLoopHoistingPass``) marks them. A kernel may have loops and branches, but
no operation for which XLA calls a library or has a kernel of its own, such as scatter, sort,
products of matrices, or sums of 4,096 numbers and more; and XLA fails where it does not use an
argument.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.metadata import version
from math import prod
from typing import Any

import jax
from jax import core, lax
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend.core import Jaxpr, Primitive, jaxprs_in_params
from jax.interpreters import ad, batching, mlir

MOST_TERMS = 4095
"""Most numbers of a sum in a kernel."""

_MOST_NUMBERS = 64
"""Most numbers of an array in a step that is a kernel: XLA fails where an operand of a kernel is a
large constant of the program."""

_KNOWN = version("jaxlib").startswith("0.10.")
"""Whether this version of XLA is known to make kernels of calls."""

# fmt: off
ARITHMETIC = {
    "abs", "add", "and", "atan", "atan2", "clamp", "convert_element_type", "copy", "cos", "cosh",
    "custom_jvp_call", "div", "eq", "exp", "exp2", "expm1", "ge", "gt", "integer_pow", "is_finite",
    "jit", "le", "log", "log1p", "logistic", "lt", "max", "min", "mul", "ne", "neg", "not", "or",
    "pow", "rsqrt", "select_n", "sign", "sin", "sinh", "sqrt", "square", "stop_gradient", "sub",
    "tan", "tanh",
}
"""Operations on single numbers that may be part of a kernel."""

_OF_ARRAYS = {
    "broadcast_in_dim", "concatenate", "iota", "name", "optimization_barrier", "pad", "reduce_and",
    "reduce_max", "reduce_min", "reduce_or", "reduce_sum", "remat2", "reshape", "scan", "slice",
    "split", "squeeze", "stack", "transpose", "unstack",
}
# fmt: on


def are_available() -> bool:
    """Whether kernels can be made of programs here."""
    return _KNOWN and jax.default_backend() == "cpu"


def is_arithmetic(program: Jaxpr) -> bool:
    """Whether a program, with those that it calls, has operations on single numbers only."""
    return all(
        step.primitive.name in ARITHMETIC | {"add_any"}
        and all(map(is_arithmetic, jaxprs_in_params(step.params)))
        for step in program.eqns
    )


def in_kernel(result: Any) -> Any:
    """The result of a call, which is one kernel."""
    return set_xla_metadata(result, xla_cpu_small_call="true", inlineable="false")


def as_kernel(function: Callable[..., Any], *args: Any, wanted: bool = True) -> Any:
    """``function(*args)``, as one kernel where that can be made: of one run, not differentiated.

    Calls with a batching rule of their own (``where_needed``) can be if they are marked themselves.
    """
    if not wanted or not are_available():
        return function(*args)
    program, shapes = jax.make_jaxpr(function, return_shape=True)(*args)
    if not _may_be_kernel(program.jaxpr):
        return function(*args)

    @jax.jit
    def call(consts: Any, args: Any) -> Any:
        consts, leaves = _used((consts, jax.tree.leaves(args)))
        return core.eval_jaxpr(program.jaxpr, consts, *leaves)

    results = _marked.bind(*call(program.consts, args))
    return jax.tree.unflatten(jax.tree.structure(shapes), results)


def _may_be_kernel(program: Jaxpr) -> bool:
    for step in program.eqns:
        name = step.primitive.name
        if name == "custom_vmap_call" and any(map(_is_marked, jaxprs_in_params(step.params))):
            continue
        if name not in ARITHMETIC | _OF_ARRAYS:
            return False
        if any(prod(getattr(x.aval, "shape", ())) > _MOST_NUMBERS for x in step.invars):
            return False
        if not all(map(_may_be_kernel, jaxprs_in_params(step.params))):
            return False
    return True


def _is_marked(program: Jaxpr) -> bool:
    """Whether a part of a program is a kernel."""
    return any(
        step.primitive.name == "xla_metadata_value"
        or any(map(_is_marked, jaxprs_in_params(step.params)))
        for step in program.eqns
    )


@jax.custom_jvp
def _used(args: Any) -> Any:
    """The arguments of a call that uses all of them; as they are where it is differentiated."""
    return lax.optimization_barrier(args)


@partial(_used.defjvp, symbolic_zeros=True)
def _(values: Any, changes: Any) -> Any:
    return values[0], changes[0]


_marked = Primitive("marked_as_kernel")
"""``in_kernel`` of several results of a call, of which derivatives and batches are not one."""

_marked.multiple_results = True
_marked.def_impl(lambda *values: [*values])
_marked.def_abstract_eval(lambda *shapes: shapes)
ad.primitive_jvps[_marked] = lambda values, changes: (values, changes)
# XLA hands sums over large batches to a library, which a kernel cannot call.
batching.primitive_batchers[_marked] = lambda values, axes: (values, axes)
_lowered = mlir.lower_fun(lambda *results: in_kernel(results), multiple_results=True)
mlir.register_lowering(_marked, _lowered, cacheable=False)
