"""The reference from event to event has weights at the ends of springs, sliders and faces."""

import numpy as np

from tests.simulation.contact.rods_without_memory import Face, Frame, Run, Slider, Spring, ricker
from tests.simulation.test_initial import coulomb


def test_it_decays_as_coulomb_says():
    """A rotation of inertia 2 on a spring of 2; friction acts at an arm of 1.6."""
    frame = Frame((2.0,), (Spring(2.0, 1.0, 1.0, ((0, 1.0),)),), (Slider(0.125, ((0, 1.6),)),))
    t = np.linspace(0.5, 14.0, 28)
    x = Run(frame, lambda t: 0.0, start=((1.05,), (0.0,))).path(t)
    exact, stops = coulomb(t, 1.05, 0.0, 0.1)
    assert 3 < stops < 16
    np.testing.assert_allclose(x[:, 0], exact, rtol=0, atol=1e-9)


def test_it_holds_joints_that_share_a_rotation():
    """Two that stick leave one of three unknowns: an oscillator of one."""
    masses, wave = (1.0, 0.8, 0.3), ricker(0.2, [2.0], [1.5])
    rods = tuple(Spring(k, 1.0, 1.0, ((i, 1.0),)) for i, k in enumerate((2.0, 3.0, 1.0)))
    ends = ((0, 1.0), (2, 0.5)), ((1, 1.0), (2, -0.4))
    frame = Frame(masses, rods, tuple(Slider(50.0, e) for e in ends), (), (1.0, 1.0, 0.0))
    free = np.array([-0.5, 0.4, 1.0])  # what neither joint sees
    mass, stiffness = free**2 @ masses, free**2 @ [2.0, 3.0, 1.0]
    load = (free * masses) @ frame.influence
    alone = Frame((mass,), (Spring(stiffness, 1.0, 1.0, ((0, 1.0),)),), influence=(load / mass,))
    t = np.array([1.0, 2.0, 4.5])
    x, turned = Run(frame, wave).path(t), Run(alone, wave).path(t)
    np.testing.assert_allclose(x, turned * free, rtol=0, atol=1e-9)
    assert np.abs(turned).min() > 0.01


def test_it_takes_what_an_impact_takes():
    """A rotation without gravity and springs to speak of hits a stop at an arm, at 2.5 of time."""
    arm, e = 0.5, 0.6
    stop = Face(0, 1, 0.25, e)
    frame = Frame(
        (2.0,), (Spring(1e-14, 1.0, 1.0, ((0, 1.0),)),), (Slider(0.0, ((0, arm),)),), (stop,)
    )
    x = Run(frame, lambda t: 0.0, start=((0.0,), (0.2,))).path([2.0, 3.5])
    np.testing.assert_allclose(x[:, 0], (0.4, 0.5 - e * 0.2), rtol=0, atol=1e-10)
