"""From structures and a ground motion to a scan over the instants; Richardson extrapolation.

``simulate`` and ``demand`` observe a ``Rollout`` at every instant; those who look for the design
point of an event observe it at one of them.

Extrapolation runs at two steps, so that the leading errors cancel: an error of c h² + O(h³) leaves
O(h³) in (4 y(h/2) − y(h))/3. Friction's events are located within their step, so that c does not
jump with where they fall; impacts are not as regular.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Hashable, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jax.tree_util import keystr

from jaxpound._checks import Rule, all_hold
from jaxpound._fields import Quantity, node_classes, rules, walk
from jaxpound._xla.batches import spread, without_mesh
from jaxpound._xla.derivatives import recomputed
from jaxpound._xla.plan import choice
from jaxpound._xla.quotients import differentiated_with, for_each_run, unknown
from jaxpound.grid import TimeGrid
from jaxpound.ground.motion import Excitation, Ground, as_motion
from jaxpound.ground.supports import at_support, require_supports
from jaxpound.model.hysteresis import zener_of
from jaxpound.model.initial import InitialState, initial_rules
from jaxpound.model.system import Structures, System
from jaxpound.results.response import Response
from jaxpound.simulation.constants import StepConstants, has_flows
from jaxpound.simulation.scheme import Scheme, is_stable
from jaxpound.simulation.state import Instant, Now, RunState
from jaxpound.simulation.step import one_step
from jaxpound.simulation.time.scan import scan_with_history

T = TypeVar("T")


def program_key(case: Any) -> Hashable:
    """What a run's program depends on beside its arguments: classes of the case, choice of plan."""
    return node_classes(case), choice()


class Rollout(NamedTuple):
    """Everything a scan over the instants of a run needs."""

    system: System  # the structures in the run's dtype
    constants: StepConstants
    zero: jax.Array  # 0, or NaN in a run whose input breaks a rule, which makes all of it NaN
    start: RunState
    extra: Any  # the caller's further numbers, cast and spread as all others are
    advance: Callable[..., Any]
    """From the state, the history sums, the step m, its input, and whether it is ``with_flows``, to
    the next state, each rod's c_m and the instant t_m."""
    scan: Callable[..., tuple[Any, Any]]  # ``scan_with_history`` of these steps

    def observed(
        self, observe: Callable[[Any, Instant, jax.Array], tuple[Any, Any]], start: Any
    ) -> tuple[tuple[RunState, Any], Any]:
        """The run with ``observe`` at every instant.

        It makes of the last result (at first ``start``), the instant t_m and its number m the next
        result, and what is stored of the instant. Returns the state and the result at the end, and
        the series of what was stored.
        """

        def step(with_flows: bool, carry: Any, *inputs: Any) -> Any:
            state, result = carry
            state, c, now = self.advance(state, *inputs, with_flows)
            result, stored = observe(result, now, inputs[1])
            return (state, result), c, stored if with_flows else (stored, now.needs_flow)

        short = partial(step, False) if has_flows(self.system) else None
        return self.scan(partial(step, True), (self.start, start), short=short)

    @staticmethod
    def of(
        structures: Structures,
        ground: Ground,
        grid: TimeGrid,
        scheme: Scheme,
        extra: Any = None,
        extra_rules: Callable[[Any], list[Rule]] = lambda extra: [],
        keep: bool = False,
        initial: InitialState | None = None,
        loads: Mapping[int, Ground] | None = None,
    ) -> Rollout:
        """The rollout of structures under a ground motion, which is a pytree; see ``simulate``.

        ``extra`` is a pytree of further numbers that the run uses; ``keep`` says whether its every
        instant is kept; ``loads`` are by mass as ground motions are.
        """
        dtype = jnp.result_type(float, *jax.tree.leaves((structures, ground)))
        cast = partial(jax.tree.map, lambda x: jnp.asarray(x, dtype))
        structures, ground, extra, initial = cast((structures, ground, extra, initial))
        loads = cast(loads or {})
        memories = [zener_of(rod.material) for rod in structures.system().rods]
        orders = [unknown(jnp.asarray(rod.order, dtype)) for rod in memories if rod is not None]
        n_supports = structures.system().topology.n_supports
        excitations = _excitations(ground, n_supports, loads, grid, scheme)
        series = [x.series for x in excitations]
        numbers = spread((structures, extra, initial, ground, loads, series))
        if has_flows(structures.system()):
            orders, numbers = without_mesh((orders, numbers))
        structures, extra, initial, ground, loads, series = numbers
        system = cast(structures.system())
        dt = grid.dt

        # A run that breaks a rule starts from NaN, and so is NaN throughout.
        stated = structures, system, ground, *loads.values()
        valid = all_hold(rule for x in stated for rule in rules(x))
        valid &= all_hold(extra_rules(extra)) & is_stable(system, dt, scheme)
        valid &= all_hold([] if initial is None else initial_rules(initial, system, dt))
        zero = unknown(jnp.where(valid, jnp.zeros((), dtype), jnp.nan))
        if any(link.contact or link.velocity_friction for link in system.links):
            zero = differentiated_with(zero, (structures, ground, extra, initial, loads))
        system, extra = for_each_run((system, extra), zero)
        displaced = velocities = None
        if initial is not None:
            displaced, velocities = ([zero + y for y in ys] for ys in initial.of(system))
        constants = StepConstants.of(system, scheme, dt, keep, displaced, bool(loads))
        start = constants.start(zero, displaced, velocities)
        excitations = _excitations(ground, n_supports, loads, grid, scheme)
        # The paper has x_0 = x_1 = 0: there the step to t_1 begins from the start, too.
        begins = 0 if scheme.start == "rest" or initial is not None else 1

        def advance(
            state: RunState, sums: list[jax.Array], m: jax.Array, entry: Any, with_flows: bool
        ) -> Any:
            time, is_first = m.astype(dtype) * dt, m == 0
            inputs = zip(excitations, entry, strict=True)
            both = [x.at(jnp.maximum(time, 0), of_input) for x, of_input in inputs]
            (a, mean), *others = [
                [jnp.where(m < 0, zero, jnp.asarray(x, dtype)) for x in pair] for pair in both
            ]
            of_supports, by_mass = others[:n_supports], others[n_supports:]
            # The run begins in the middle of its first step, at t = 0.
            kick = jnp.where(is_first, 0.5, 1.0).astype(dtype)
            now = Now(time, a, mean, is_first, m == grid.n_steps, kick)
            if of_supports:
                at_instant, in_mean = map(tuple, zip(*of_supports, strict=True))
                now = now._replace(supports=at_instant, mean_supports=in_mean)
            if loads:
                on = dict(zip(loads, by_mass, strict=True))
                pairs = [on.get(mass, (zero, zero)) for mass in range(len(system.masses))]
                at_instant, in_mean = map(tuple, zip(*pairs, strict=True))
                now = now._replace(loads=at_instant, mean_loads=in_mean)
            if begins or initial is not None:
                state = jax.tree.map(lambda x, y: jnp.where(m <= begins, x, y), start, state)
            return one_step(constants, state, sums, now, with_flows)

        if constants.plan.recomputed_steps:
            advance = recomputed(advance, static_argnums=(4,), but_kept=True)

        scan = partial(
            scan_with_history,
            n_steps=grid.n_steps,
            orders=orders,
            history=scheme.history,
            inputs=series,
            checkpoint=scheme.checkpoint,
            plan=constants.plan,
        )
        return Rollout(system, constants, zero, start, extra, advance, scan)


def _excitations(
    ground: Ground, n_supports: int, loads: Mapping[int, Ground], grid: TimeGrid, scheme: Scheme
) -> list[Excitation]:
    """Of motions of the ground, of the supports from the last to the second, and of loads."""
    require_supports(ground, n_supports + 1)
    motions = [at_support(ground, k) for k in (0, *range(n_supports, 0, -1))]
    return [as_motion(x).excitation(grid, scheme.order) for x in (*motions, *loads.values())]


def extrapolated(coarse: T, fine: T) -> T:
    """Results of a run from those of the same run at half the step, leaf by leaf."""

    def leaf(coarse: Any, fine: Any) -> Any:
        is_finite = jnp.isfinite(coarse) & jnp.isfinite(fine)  # a gap may be infinite
        coarse = jnp.where(is_finite, coarse, 0.0)
        return jnp.where(is_finite, (4 * jnp.where(is_finite, fine, 0.0) - coarse) / 3, fine)

    return jax.tree.map(leaf, coarse, fine)


def extrapolated_response(coarse: Response, fine: Response) -> Response:
    """A response, with the smooth series and all scalars extrapolated."""
    smooth = {path for path, spec, _ in walk(coarse, Quantity) if spec.smooth}

    def leaf(path: Any, old: Any, new: Any) -> Any:
        is_smooth = keystr(path, simple=True, separator=".") in smooth
        return extrapolated(old, new[::2]) if is_smooth else old

    series = jax.tree.map_with_path(leaf, coarse, fine)
    return dataclasses.replace(series, demand=extrapolated(coarse.demand, fine.demand))
