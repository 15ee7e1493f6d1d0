"""Rules for input, and the frozen dataclasses that JAX can trace."""

import copy
import dataclasses
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpound as jp
from jaxpound import _checks
from jaxpound._checks import (
    Rule,
    all_hold,
    enforce,
    finite,
    instance,
    is_traced,
    is_whole,
    machine_memory,
    not_negative,
    number,
    positive,
    real,
    require_batch,
    require_memory,
)
from jaxpound._fields import label, pytree_dataclass, static
from tests.refusals import assert_refused


@pytree_dataclass
class Spring:
    """A toy: two numbers, something that shapes the program, and a name."""

    stiffness: object
    length: object
    law: str = static(default="linear")
    name: str = label(default="unnamed")

    def __post_init__(self):
        enforce("Spring", [Rule("stiffness", self.stiffness, self.stiffness > 0, "positive")])


class Foreign:
    """Another library's array: it has a dtype, but JAX does not know it."""

    dtype = "theirs"

    def __array__(self, dtype=None, copy=None):
        return np.array([1.0, 2.0])


# Rules


@pytest.mark.parametrize("one", [3, np.int8(3), np.array(3), jnp.int32(3), np.uint16(3)])
def test_whole_numbers_may_be_arrays_of_a_single_one(one):
    assert is_whole(one)
    link = jp.FloorLink(one, 0, next_floor=one)
    assert (link.building, link.next_floor) == (3, 3)
    assert {type(link.building), type(link.next_floor)} == {int}


@pytest.mark.parametrize(
    "other", [True, np.True_, jnp.bool_(1), 3.0, jnp.float32(3), np.array([3]), "3", None]
)
def test_other_values_are_no_whole_numbers(other):
    assert not is_whole(other)


def test_a_traced_number_is_no_known_whole_number():
    with pytest.raises(ValueError, match=r"building = .* must be a whole number from 0 on"):
        jax.jit(lambda i: jp.FloorLink(i, 0).friction)(3)
    assert not is_whole(jax.random.key(0))


def test_broken_rule_raises_with_owner_argument_value_and_rule():
    with pytest.raises(ValueError, match=r"^Owner: mass = -2\.5 must be positive$"):
        enforce("Owner", [Rule("mass", -2.5, False, "positive")])


def test_broken_rule_of_an_array_names_the_first_bad_entry():
    value = np.array([[1.0, 2.0], [3.0, -4.0], [-5.0, 6.0]])
    with pytest.raises(ValueError, match=r"mass = -4 \(at index \[1, 1\]\) must be positive"):
        enforce("Owner", [Rule("mass", value, value > 0, "positive")])


def test_rule_may_depend_on_an_array_while_its_value_is_a_number():
    limit = np.array([1.0, 9.0])
    with pytest.raises(ValueError, match=r"mass = 2 \(at index \[1\]\) must be above"):
        enforce("Owner", [Rule("mass", 2.0, limit < 2, "above the limit")])


def test_first_broken_rule_is_the_one_reported():
    rules = [Rule("a", 1.0, True, "x"), Rule("b", 2.0, False, "y"), Rule("c", 3.0, False, "z")]
    assert_refused("b = 2", enforce, "Owner", rules)


def test_rules_that_hold_do_not_raise():
    enforce("Owner", [Rule("a", 1.0, True, "x"), Rule("b", np.ones(3), np.ones(3, bool), "y")])


def test_enforce_lets_traced_values_pass():
    def checked(x):
        enforce("Owner", [Rule("x", x, x > 0, "positive")])
        return x

    assert jax.jit(checked)(-1.0) == -1
    np.testing.assert_array_equal(jax.vmap(checked)(jnp.array([-1.0, 1.0])), [-1, 1])
    assert jax.grad(checked)(-1.0) == 1


def test_enforce_lets_a_known_value_pass_whose_limit_is_traced():
    def checked(limit):
        enforce("Owner", [Rule("x", 1.0, limit < 1.0, "above the limit")])
        return limit

    assert jax.jit(checked)(2.0) == 2


@pytest.mark.parametrize(
    ("held", "expected"),
    [
        ([True, True], True),
        ([True, False], False),
        ([np.array([True, False])], False),
        ([np.array([True, True]), jnp.array(True)], True),
        ([], True),
    ],
)
def test_all_hold_is_whether_every_rule_holds_everywhere(held, expected):
    assert bool(all_hold([Rule("x", 0.0, h, "so") for h in held])) is expected


def test_all_hold_is_a_flag_that_can_be_traced_and_batched():
    flags = jax.jit(jax.vmap(lambda x: all_hold([Rule("x", x, x > 0, "positive")])))
    np.testing.assert_array_equal(flags(jnp.array([1.0, -1.0, jnp.nan])), [True, False, False])


def test_finite_refuses_infinities_and_nan():
    values = [0.0, -1e300, np.inf, -np.inf, np.nan]
    np.testing.assert_array_equal(finite(np.array(values)), [True, True, False, False, False])
    np.testing.assert_array_equal(jax.jit(finite)(jnp.array(values)), [True, True] + [False] * 3)


def test_is_traced_sees_tracers_anywhere_in_a_tree():
    seen = []
    jax.jit(lambda x: seen.append((is_traced({"a": [1, (x,)]}), is_traced([1, np.ones(2)]))))(1.0)
    assert seen == [(True, False)]


# Numbers


@pytest.mark.parametrize(
    "value",
    [None, "a", "1", True, 1j, print, {}, [True, False], np.array("x"), [1j], [[1.0], [1, 2]]],
    ids=repr,
)
def test_what_is_no_real_number_is_refused_by_name(value):
    with pytest.raises(ValueError, match=r"^Owner: mass = .* (must be a real|is not a) number"):
        real("Owner", "mass", value)


def test_refusal_of_a_long_value_stays_short():
    with pytest.raises(ValueError, match="Owner: mass = ") as caught:
        real("Owner", "mass", ["text"] * 10_000)
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("value", [3, np.int8(3), np.uint16(3), np.array(3), 10**30], ids=repr)
def test_whole_numbers_become_floats(value):
    result = real("Owner", "mass", value)
    assert np.asarray(result).dtype == np.float64
    assert result == float(value)


def test_whole_numbers_of_jax_become_floats():
    assert real("Owner", "mass", jnp.arange(3)).dtype == jnp.float64


def test_an_integer_beyond_all_floats_is_refused():
    assert_refused(r"mass = 1000.* too large", real, "Owner", "mass", 10**400)


@pytest.mark.parametrize(
    "value", [np.float32(0.5), np.ones(2, np.float32), np.array(0.5, np.float16)], ids=repr
)
def test_floats_keep_their_precision(value):
    assert real("Owner", "mass", value).dtype == value.dtype
    assert real("Owner", "mass", jnp.asarray(value)).dtype == value.dtype


@pytest.mark.parametrize(
    "value", [[1, 2], (1.0, 2.0), np.array([1.0, 2.0], ">f4"), np.longdouble([1, 2]), Foreign()]
)
def test_anything_like_an_array_becomes_one_that_jax_takes(value):
    result = real("Owner", "mass", value)
    np.testing.assert_array_equal(jax.jit(lambda x: 2 * x)(result), [2.0, 4.0])


def test_list_that_holds_traced_numbers_becomes_a_traced_array():
    result = jax.jit(lambda x: real("Owner", "mass", [x, 3.0]))(2.0)
    np.testing.assert_array_equal(result, [2.0, 3.0])


def test_number_refuses_arrays_known_or_traced():
    assert number("Owner", "dt", 0.5) == 0.5
    with pytest.raises(ValueError, match=r"Owner: dt of shape \(2,\) must be one number"):
        number("Owner", "dt", [0.1, 0.2])
    with pytest.raises(ValueError, match=r"Owner: dt of shape \(2,\) must be one number"):
        jax.jit(lambda x: number("Owner", "dt", x))(jnp.ones(2))


@pytest.mark.parametrize("bad", [0, -1.0, np.nan, np.inf])
def test_positive_returns_floats_and_refuses_the_rest(bad):
    assert positive("Owner", a=1, b=2.5) == [1.0, 2.5]
    assert_refused(r"Owner: b = .* must be positive and finite", positive, "Owner", a=1, b=bad)


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_not_negative_returns_floats_and_refuses_the_rest(bad):
    assert not_negative("Owner", a=0, b=2.5) == [0.0, 2.5]
    with pytest.raises(ValueError, match=r"Owner: b = .* must be finite and not negative"):
        not_negative("Owner", a=1, b=bad)


def test_batch_refuses_shapes_that_cannot_be_broadcast():
    require_batch("Owner", a=1.0, b=np.ones(3), c=np.ones((2, 1)))
    with pytest.raises(ValueError, match=r"Owner: the shapes of a \(2,\), b \(3,\) must make one"):
        require_batch("Owner", a=np.ones(2), b=np.ones(3))


def test_instance_names_the_argument_and_the_type_it_wants():
    instance("Owner", "spring", 3, int, str)
    with pytest.raises(ValueError, match="Owner: spring = 3 must be of type str or Spring"):
        instance("Owner", "spring", 3, str, Spring)


# Frozen dataclasses


def test_objects_are_frozen():
    spring = Spring(1.0, 2.0)
    for change in (
        lambda: setattr(spring, "stiffness", 2.0),
        lambda: setattr(spring, "colour", "red"),
        lambda: delattr(spring, "length"),
    ):
        with pytest.raises(dataclasses.FrozenInstanceError):
            change()


def test_only_continuous_fields_are_leaves_and_their_paths_can_be_read():
    leaves = jax.tree_util.tree_leaves_with_path({"s": Spring(1.0, 2.0, law="cubic", name="a")})
    assert [(jax.tree_util.keystr(path), leaf) for path, leaf in leaves] == [
        ("['s'].stiffness", 1.0),
        ("['s'].length", 2.0),
    ]


@pytest.mark.parametrize(
    "leaf", [None, object(), -1.0, "text", 0, np.nan], ids=lambda leaf: type(leaf).__name__
)
def test_rebuilding_judges_no_leaf(leaf):
    structure = jax.tree.structure(Spring(1.0, 2.0, law="cubic"))
    rebuilt = jax.tree.unflatten(structure, [leaf, leaf])
    assert type(rebuilt) is Spring
    assert rebuilt.stiffness is leaf
    assert rebuilt.length is leaf
    assert rebuilt.law == "cubic"


def test_construction_and_replacement_are_judged():
    spring = Spring(1.0, 2.0, law="cubic", name="a")
    assert_refused("Spring: stiffness = -1 must be positive", Spring, -1.0, 2.0)
    with pytest.raises(ValueError, match="Spring: stiffness = -1 must be positive"):
        dataclasses.replace(spring, stiffness=-1.0)
    other = dataclasses.replace(spring, length=3.0)
    assert (other.stiffness, other.length, other.law, other.name) == (1.0, 3.0, "cubic", "a")
    assert spring.length == 2.0


def test_transformations_keep_static_fields_and_drop_labels():
    spring = Spring(1.0, 2.0, law="cubic", name="mine")
    for after in (jax.jit(lambda s: s)(spring), jax.tree.map(lambda x: x, spring)):
        assert after.law == "cubic"
        assert after.name == "unnamed"


def test_labels_and_values_cause_no_retrace_but_static_fields_do():
    traces = []

    @jax.jit
    def energy(spring):
        traces.append(spring.law)
        return spring.stiffness * spring.length**2 / 2

    assert energy(Spring(2.0, 3.0, name="a")) == 9
    assert energy(Spring(2.0, 3.0, name="b")) == 9
    assert energy(Spring(4.0, 1.0)) == 2
    assert traces == ["linear"]
    energy(Spring(2.0, 3.0, law="cubic"))
    assert traces == ["linear", "cubic"]


def test_gradient_of_an_object_is_an_object():
    gradient = jax.grad(lambda s: s.stiffness * s.length**2)(Spring(2.0, 3.0, law="cubic"))
    assert type(gradient) is Spring
    assert (gradient.stiffness, gradient.length, gradient.law) == (9.0, 12.0, "cubic")


def test_objects_can_be_copied_and_pickled():
    spring = Spring(1.0, 2.0, law="cubic", name="a")
    for twin in (copy.deepcopy(spring), pickle.loads(pickle.dumps(spring))):
        assert type(twin) is Spring
        assert vars(twin) == vars(spring)


# Sizes


@pytest.mark.parametrize(
    ("value", "size", "message"),
    [
        (1_000_000, 8 * 10**12, "n = 1,000,000 would take 8 TB of memory; this machine has 24 GB"),
        (10**12, 20 * 10**9, "n = 1,000,000,000,000 would take 20 GB of memory"),
        (10**18, 8 * 10**18, r"n = 1.00e\+18 would take 8 EB"),
    ],
)
def test_what_memory_has_no_room_for_is_refused_with_its_bytes(small_machine, value, size, message):
    assert_refused(f"^owner: {message}", require_memory, "owner", "n", value, size)


def test_numbers_that_cannot_be_written_out_are_told_all_the_same(small_machine):
    with pytest.raises(ValueError, match=r"n = 1.00e\+6000 would take 8.00e\+5982 EB"):
        require_memory("owner", "n", 10**6000, 8 * 10**6000)


def test_what_memory_has_room_for_is_not_refused(small_machine):
    require_memory("owner", "n", 10**9, 19 * 10**9)


def test_the_memory_of_this_machine_is_the_least_that_is_known(monkeypatch, tmp_path):
    monkeypatch.setattr(_checks, "_CONTAINER_LIMITS", ())
    whole = machine_memory()
    assert 10**8 < whole < 10**15
    for text, known in (("max\n", whole), ("1000000\n", 1_000_000), ("0\n", whole)):
        (tmp_path / "limit").write_text(text)
        monkeypatch.setattr(_checks, "_CONTAINER_LIMITS", (str(tmp_path / "limit"),))
        assert machine_memory() == known


def test_a_system_that_does_not_tell_its_memory_refuses_nothing(monkeypatch):
    monkeypatch.setattr(_checks, "_CONTAINER_LIMITS", ())
    monkeypatch.delattr(_checks.os, "sysconf")
    require_memory("owner", "n", 1, 10**15)
