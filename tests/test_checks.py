"""Rules for input, and the frozen dataclasses that JAX can trace."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import _checks
from jaxpound._checks import Rule, all_hold, enforce, finite, is_traced, is_whole, real
from jaxpound._fields import label, pytree_dataclass, static
from tests.refusals import refused


@pytree_dataclass
class Spring:
    """A toy: two numbers, something that shapes the program, and a name."""

    stiffness: object
    length: object
    law: str = static(default="linear")
    name: str = label(default="unnamed")


class Foreign:
    """Another library's array: it has a dtype, but JAX does not know it."""

    dtype = "theirs"

    def __array__(self, dtype=None, copy=None):
        return np.array([1.0, 2.0])


def test_whole_numbers_are_known_single_integers_of_any_library():
    for whole in (3, np.int8(3), np.array(3), jnp.int32(3), np.uint16(3)):
        assert is_whole(whole)
        link = jp.FloorLink(whole, 0, next_floor=whole)
        assert (link.building, link.next_floor) == (3, 3)
        assert {type(link.building), type(link.next_floor)} == {int}
    for other in (True, np.True_, jnp.bool_(1), 3.0, jnp.float32(3), np.array([3]), "3", None):
        assert not is_whole(other), other
    refused("building = .* must be a whole numb", jax.jit(lambda i: jp.FloorLink(i, 0).friction), 3)
    assert not is_whole(jax.random.key(0))


def test_a_broken_rule_raises_with_owner_argument_value_index_and_rule():
    value, limit = np.array([[1.0, 2.0], [3.0, -4.0], [-5.0, 6.0]]), np.array([1.0, 9.0])
    for rule, message in (
        (("mass", -2.5, False, "positive"), r"^enforce: mass = -2\.5 must be positive$"),
        (("mass", value, value > 0, "so"), r"mass = -4 \(at index \[1, 1\]\) must be so"),
        (("mass", 2.0, limit < 2, "above the limit"), r"mass = 2 \(at index \[1\]\) must be above"),
    ):
        refused(message, enforce, [Rule(*rule)])
    rules = [Rule("a", 1.0, True, "x"), Rule("b", 2.0, False, "y"), Rule("c", 3.0, False, "z")]
    refused("b = 2", enforce, rules)
    enforce([Rule("a", 1.0, True, "x"), Rule("b", np.ones(3), np.ones(3, bool), "y")])


def test_rules_hold_everywhere_or_not_known_or_traced():
    def checked(x):
        enforce([Rule("x", x, x > 0, "positive")])
        return x

    assert jax.jit(checked)(-1.0) == -1
    np.testing.assert_array_equal(jax.vmap(checked)(jnp.array([-1.0, 1.0])), [-1, 1])
    assert jax.grad(checked)(-1.0) == 1

    def checked(limit):
        enforce([Rule("x", 1.0, limit < 1.0, "above the limit")])
        return limit

    assert jax.jit(checked)(2.0) == 2
    yes, mixed = np.array([True, True]), np.array([True, False])
    for held in ([True, True], [yes, jnp.array(True)], []):
        assert all_hold([Rule("x", 0.0, holds, "so") for holds in held])
    for held in ([True, False], [mixed]):
        assert not all_hold([Rule("x", 0.0, holds, "so") for holds in held])
    flags = jax.jit(jax.vmap(lambda x: all_hold([Rule("x", x, x > 0, "positive")])))
    np.testing.assert_array_equal(flags(jnp.array([1.0, -1.0, jnp.nan])), [True, False, False])
    values = [0.0, -1e300, np.inf, -np.inf, np.nan]
    np.testing.assert_array_equal(finite(np.array(values)), [True, True, False, False, False])
    np.testing.assert_array_equal(jax.jit(finite)(jnp.array(values)), [True, True] + [False] * 3)
    seen = []
    jax.jit(lambda x: seen.append((is_traced({"a": [1, (x,)]}), is_traced([1, np.ones(2)]))))(1.0)
    assert seen == [(True, False)]


def test_what_is_no_real_number_is_refused_by_name():
    lists = [True, False], np.array("x"), [1j], [[1.0], [1, 2]]
    for value in (None, "a", "1", True, 1j, print, {}, *lists):
        refused(r"^real: mass = .* (must be a real|is not a) number", real, "mass", value)
    with pytest.raises(ValueError, match=r"^real: mass = ") as caught:
        real("mass", ["text"] * 10_000)
    assert len(str(caught.value)) < 200


def test_numbers_become_floats_and_arrays_that_jax_takes():
    for whole in (3, np.int8(3), np.uint16(3), np.array(3), 10**30):
        result = real("mass", whole)
        assert np.asarray(result).dtype == np.float64
        assert result == float(whole)
    assert real("mass", jnp.arange(3)).dtype == jnp.float64
    refused(r"mass = 1000.* too large", real, "mass", 10**400)
    for value in (np.float32(0.5), np.ones(2, np.float32), np.array(0.5, np.float16)):
        assert real("mass", value).dtype == value.dtype
        assert real("mass", jnp.asarray(value)).dtype == value.dtype
    like = [1, 2], (1.0, 2.0), np.array([1.0, 2.0], ">f4"), np.longdouble([1, 2]), Foreign()
    for value in like:
        result = real("mass", value)
        np.testing.assert_array_equal(jax.jit(lambda x: 2 * x)(result), [2.0, 4.0])
    # A list that holds traced numbers becomes a traced array.
    result = jax.jit(lambda x: real("mass", [x, 3.0]))(2.0)
    np.testing.assert_array_equal(result, [2.0, 3.0])


def test_static_fields_shape_the_program_and_labels_do_not():
    spring = Spring(1.0, 2.0, law="cubic", name="mine")
    for after in (jax.jit(lambda s: s)(spring), jax.tree.map(lambda x: x, spring)):
        assert (after.law, after.name) == ("cubic", "unnamed")
    traces = []

    @jax.jit
    def energy(spring):
        traces.append(spring.law)
        return spring.stiffness * spring.length**2 / 2

    assert energy(Spring(2.0, 3.0, name="a")) == energy(Spring(2.0, 3.0, name="b")) == 9
    assert energy(Spring(4.0, 1.0)) == 2
    assert traces == ["linear"]
    energy(Spring(2.0, 3.0, law="cubic"))
    assert traces == ["linear", "cubic"]


def test_what_memory_has_no_room_for_is_refused_with_its_bytes(small_machine):
    for value, size, message in (
        (10**6, 8 * 10**12, "1,000,000 would take 8 TB of memory; this machine has 24 GB"),
        (10**12, 20 * 10**9, "1,000,000,000,000 would take 20 GB of memory"),
        (10**18, 8 * 10**18, r"1.00e\+18 would take 8 EB"),
        (10**6000, 8 * 10**6000, r"1.00e\+6000 would take 8.00e\+5982 EB"),
    ):
        refused(f"n = {message}", _checks.require_memory, "n", value, size)
    _checks.require_memory("n", 10**9, 19 * 10**9)


def test_the_memory_of_this_machine_is_the_least_that_is_known(monkeypatch, tmp_path):
    monkeypatch.setattr(_checks, "_CONTAINER_LIMITS", ())
    whole = _checks.machine_memory()
    assert 10**8 < whole < 10**15
    for text, known in (("max\n", whole), ("1000000\n", 1_000_000), ("0\n", whole)):
        (tmp_path / "limit").write_text(text)
        monkeypatch.setattr(_checks, "_CONTAINER_LIMITS", (str(tmp_path / "limit"),))
        assert _checks.machine_memory() == known
    monkeypatch.setattr(_checks, "_CONTAINER_LIMITS", ())
    monkeypatch.delattr(_checks.os, "sysconf")
    _checks.require_memory("n", 1, 10**15)
