"""What reverse mode keeps; derivatives in both modes of a loop, of which JAX has those of one."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jax.flatten_util import ravel_pytree

T = TypeVar("T")
Program = Callable[..., Any]
_KEPT = "kept"


def recomputed(
    function: Program, static_argnums: tuple[int, ...] = (), *, but_kept: bool = False
) -> Program:
    """A function of which reverse mode keeps the arguments, and computes the rest anew.

    It may also keep those of its numbers that are ``kept``.
    """
    policy = jax.checkpoint_policies.save_only_these_names(_KEPT) if but_kept else None
    return jax.checkpoint(function, prevent_cse=False, policy=policy, static_argnums=static_argnums)


def kept(tree: T) -> T:
    """Numbers that take long to compute: see ``recomputed``."""
    return checkpoint_name(tree, _KEPT)


def in_both_modes(
    function: Program,
    name: str,
    is_differentiated: Callable[[Any], bool] = lambda path: True,
    mapped: Callable[[Program, bool], Program] = lambda program, reverse: program,
) -> Program:
    """``function(inputs, constants)``, a pytree of real arrays, with derivatives by the inputs.

    Reverse mode, Jᵀ w, computes the columns of the Jacobian J by forward mode, side by side, and
    stores nothing but the inputs. That suits functions of few inputs whose loop has a state of many
    numbers, and needs one program for both modes. Equinox's checkpointed loop instead stores states
    on the way and goes back through them: its time does not depend on the number of inputs, but it
    runs the loop again between the states and has the transposed body as a second program.

    Both modes share one trace of the function, which may have ``lax.while_loop``. Only leaves of
    the inputs that are ``is_differentiated``, by their path, may have a derivative other than zero.
    Each of the programs, functions of (inputs, constants, ...), is ``mapped`` before it is called,
    such as by another rule for batches; ``reverse`` says that it is that of reverse mode. Second
    derivatives are refused by a ``NotImplementedError``, which calls the function by its name.
    """
    function = jax.jit(function)
    without_second = partial(jax.tree.map, partial(no_second_derivative, name))

    @jax.jit
    def push(inputs: Any, constants: Any, change: Any) -> Any:
        return jax.jvp(lambda x: function(x, constants), (inputs,), (change,))[1]

    @jax.jit
    def pull(inputs: Any, constants: Any, weights: Any) -> Any:
        flat, rebuild = ravel_pytree(inputs)
        paths = jax.tree_util.tree_leaves_with_path(inputs)
        mask = [is_differentiated(path) for path, leaf in paths for _ in range(jnp.size(leaf))]
        numbers, places = np.flatnonzero(mask), np.cumsum(mask) - 1
        zeros = jnp.where(jnp.isfinite(flat), 0.0, 0.0).astype(flat.dtype)  # on flat's devices

        def component(change: jax.Array) -> jax.Array:
            products = jax.tree.map(jnp.multiply, push(inputs, constants, rebuild(change)), weights)
            return ravel_pytree(products)[0].sum()

        units = zeros[None] + np.eye(flat.size, dtype=flat.dtype)[numbers]
        products = jax.vmap(component)(units)
        # Picked, not put: XLA calls a library for a scatter.
        return rebuild(jnp.where(np.array(mask), products[np.maximum(places, 0)], 0.0))

    run, push_mapped, pull_mapped = (mapped(x, x is pull) for x in (function, push, pull))

    @jax.custom_jvp
    def differentiable(inputs: Any, constants: Any) -> Any:
        # Where JAX computes a run's steps anew, second derivatives reach this function itself.
        return run(without_second(inputs), constants)

    @differentiable.defjvp
    def linear(primals: Any, tangents: Any) -> Any:
        inputs, constants = primals
        out = differentiable(inputs, constants)

        # The linear map t → J t as the solution (t, J t) of [[1, 0], [−J, 1]] z = (t, 0), whose
        # transpose has the solution (a + Jᵀ b, b): so each direction has the program that suits it.
        # Only second derivatives would evaluate the system itself.
        change, as_inputs = ravel_pytree(tangents[0])
        # In one array, inputs that are the same on all devices differ as their changes do.
        inputs = as_inputs(ravel_pytree(without_second(inputs))[0])
        flat, as_out = ravel_pytree(out)
        n = change.size

        def forwards(_: Any, right: jax.Array) -> jax.Array:
            pushed = push_mapped(inputs, constants, as_inputs(right[:n]))
            return right.at[n:].add(ravel_pytree(pushed)[0])

        def backwards(_: Any, right: jax.Array) -> jax.Array:
            pulled = pull_mapped(inputs, constants, as_out(right[n:]))
            return right.at[:n].add(ravel_pytree(pulled)[0])

        right = jnp.pad(change, (0, flat.size))
        solution = lax.custom_linear_solve(lambda z: z, right, forwards, backwards)
        return out, as_out(solution[n:])

    return differentiable


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def no_second_derivative(name: str, x: Any) -> Any:
    """x, of which a derivative is refused: it would be the second one of what has the name."""
    return x


@no_second_derivative.defjvp
def _(name: str, primals: Any, tangents: Any) -> Any:
    raise NotImplementedError(f"second derivatives of {name} are not available")
