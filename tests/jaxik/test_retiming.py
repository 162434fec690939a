"""Retimed motions keep their limits as they are played, and leave no time that could be saved."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxik
from jaxik.trajectories.retiming import fastest_times, played_acceleration

V, A = 1.7, 12.0
RNG = np.random.default_rng(9)
U = np.linspace(0, 1, 150)[:, None]
SMOOTH = np.sin(U * RNG.uniform(2, 9, 7) + RNG.uniform(0, 6, 7))
MOTIONS = {
    "smooth": SMOOTH,
    "eased": np.sin(U**3 * (10 - 15 * U + 6 * U**2) * RNG.uniform(2, 9, 7)),
    "rough": SMOOTH + RNG.normal(scale=2e-3, size=SMOOTH.shape),
    "random walk": np.cumsum(RNG.normal(scale=0.1, size=(60, 3)), axis=0),
    "with rests": np.repeat(SMOOTH[::10], 2, axis=0),
    "back and forth": np.array([[0.0], [1.0], [0.0], [1.0]]),
    "at rest": np.zeros((5, 2)),
    "two waypoints": np.array([[0.0, 0.0], [0.3, 0.1]]),
    "one waypoint": np.zeros((1, 3)),
}


def played(q, time):
    """Largest speed and acceleration from rest to rest, spelled out waypoint by waypoint."""
    dt = np.diff(time)
    speed = [0 * q[0], *((q[k + 1] - q[k]) / dt[k] for k in range(len(dt))), 0 * q[0]]
    half = [0.0, *(dt / 2), 0.0]
    change = [abs(speed[k + 1] - speed[k]) / (half[k] + half[k + 1]) for k in range(len(q))]
    return np.max(np.abs(speed)), np.max(change)


def bang_bang(way, v, a):
    """Time from rest to rest over a straight way."""
    return way / v + v / a if way > v**2 / a else 2 * np.sqrt(way / a)


@pytest.mark.parametrize("name", MOTIONS)
def test_limits_hold_for_the_motion_as_played(name):
    q = MOTIONS[name]
    time = fastest_times(q, V, A)
    assert time[0] == 0
    assert (np.diff(time) > 0).all()
    if len(q) > 1:
        speed, acceleration = played(q, time)
        assert speed <= V * (1 + 1e-12)
        assert acceleration <= A * (1 + 1e-9)
        np.testing.assert_allclose(np.abs(played_acceleration(q, np.diff(time))).max(), acceleration, rtol=1e-9)
        if np.ptp(q) > 0:  # something is at its limit somewhere: otherwise all of it could be faster
            assert max(speed / V, acceleration / A) > 0.99


def test_a_straight_way_takes_the_time_of_the_schoolbook():
    for way in (0.1, 2.0):  # too short for the speed limit, and long enough
        q = np.linspace(0, way, 400)[:, None] * np.array([1.0, 0.5])
        np.testing.assert_allclose(fastest_times(q, V, A)[-1], bang_bang(way, V, A), rtol=5e-3)


def test_a_circle_is_as_fast_as_its_bend_allows():
    """Two joints on a circle: |q''| = speed² / radius may be all of the limit where one joint has it alone."""
    angle = np.linspace(0, 20 * np.pi, 6000)
    q = 0.5 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    time = fastest_times(q, 1e3, A)
    rate = np.diff(angle) / np.diff(time)
    # Constant speed needs |q''| = rate² / 2 <= A; speeding up where the bend leaves room gains a few percent.
    assert 1.0 <= np.median(rate) / np.sqrt(2 * A) < 1.1


def test_limits_may_differ_between_joints_and_finer_waypoints_converge():
    velocity, acceleration = np.linspace(0.5, 2, 7), np.linspace(20, 5, 7)
    curve = lambda n: np.sin(np.linspace(0, 1, n)[:, None] * np.arange(2, 9))  # noqa: E731
    coarse, fine = (fastest_times(curve(n), velocity, acceleration)[-1] for n in (100, 800))
    np.testing.assert_allclose(coarse, fine, rtol=0.02)
    q = curve(100)
    dt = np.diff(fastest_times(q, velocity, acceleration))
    assert (np.abs(np.diff(q, axis=0)) / dt[:, None] <= velocity * (1 + 1e-12)).all()
    assert (np.abs(played_acceleration(q, dt)) <= acceleration * (1 + 1e-9)).all()


def test_slowing_any_stretch_down_is_the_only_thing_left_to_do(rng):
    """Random local speed-ups of the times break a limit: no slack is left over a few waypoints."""
    time = fastest_times(SMOOTH, V, A)
    dt = np.diff(time)
    for _ in range(50):
        at, width = rng.integers(5, 140), rng.integers(3, 8)
        faster = dt.copy()
        faster[at : at + width] *= 0.97
        speed, acceleration = played(SMOOTH, np.append(0, np.cumsum(faster)))
        assert speed > V or acceleration > A


def test_a_trajectory_keeps_everything_but_its_times():
    swivel = np.linspace(0, 1, 150)
    names = tuple(f"j{i}" for i in range(7))
    slow = jaxik.Trajectory(5.0 + np.arange(150.0), SMOOTH, names, "arm", swivel, np.full(150, 3), ("made here",))
    fast = slow.retimed(velocity=V, acceleration=np.full(7, A))
    np.testing.assert_array_equal(fast.q, slow.q)
    np.testing.assert_array_equal(fast.swivel, swivel)
    np.testing.assert_allclose(fast.time, 5.0 + fastest_times(SMOOTH, V, A), rtol=1e-12)
    assert fast.notes == ("made here", f"retimed from 149 s to {fast.duration:.6g} s")
    np.testing.assert_allclose(np.abs(fast.qd).max(), played(SMOOTH, fast.time)[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"velocity": 0.0, "acceleration": 1.0}, r"velocity limits need to be above 0; got 0\.0"),
        ({"velocity": 1.0, "acceleration": np.array([1.0, np.nan, 1, 1, 1, 1, 1])}, "acceleration limits need"),
        ({"velocity": np.ones(6), "acceleration": 1.0}, r"one per joint, \(7,\); got shape \(6,\)"),
    ],
)
def test_bad_limits_are_refused(limits, said):
    with pytest.raises(ValueError, match=said):
        fastest_times(SMOOTH, **limits)


def test_a_retimed_plan_says_what_its_energy_is_now():
    model = jaxik.presets.iiwa14()
    energy = jaxik.energy.joint_motion() + 1e-6 * jaxik.energy.holding()
    time = np.arange(150.0)
    trajectory = jaxik.Trajectory(time, SMOOTH, model.joint_names)
    plan = jaxik.Plan(
        trajectory=trajectory,
        swivel=np.zeros(150),
        branch=np.zeros(150, int),
        energy=float(energy(model.arm, jnp.asarray(SMOOTH), jnp.asarray(time))),
        lower_bound=0.1,
        gap=0.2,
        status=jaxik.PlanStatus.OK,
        arm=model.arm,
        energy_fn=energy,
    )
    fast = plan.retimed(acceleration=A)
    q, t = jnp.asarray(fast.trajectory.q), jnp.asarray(fast.trajectory.time)
    np.testing.assert_allclose(fast.energy, energy(model.arm, q, t), rtol=1e-12)
    assert fast.energy > plan.energy  # the same waypoints in less time
    np.testing.assert_allclose(fast.parts["joint motion [rad²/s]"], jaxik.energy.joint_motion()(model.arm, q, t))
    assert fast.lower_bound is None
    assert fast.gap is None
    assert (np.abs(fast.trajectory.qd) <= np.asarray(model.arm.velocity_limit) * (1 + 1e-12)).all()
    assert f"{fast.energy:.6g}" in fast.report()
    slower = plan.retimed(acceleration=A, velocity=0.1)
    np.testing.assert_allclose(np.abs(slower.trajectory.qd).max(), 0.1, rtol=1e-2)


def test_a_plan_without_a_motion_has_none_to_retime():
    nothing = jaxik.Plan(
        trajectory=None,
        swivel=np.zeros(2),
        branch=np.zeros(2, int),
        energy=float("inf"),
        lower_bound=None,
        gap=None,
        status=jaxik.PlanStatus.DISCONNECTED,
        problems=("cut at 1",),
    )
    with pytest.raises(jaxik.UnreachableError, match="cut at 1"):
        nothing.retimed(acceleration=1.0)
