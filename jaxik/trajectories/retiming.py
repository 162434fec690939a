"""Time-optimal timing of given waypoints within joint velocity and acceleration limits.

The waypoints stay, only their times change. The path parameter s sums, step by step, the least time that the velocity
limits allow, so that ds/dt <= 1 is the velocity limit. In x = (ds/dt)², with constant acceleration along each step,
limits on velocity and acceleration are linear, and two passes find the largest x at every waypoint: backward the
largest x from which the end can still be reached, forward the largest x that can be reached.

1. Q.-C. Pham, H. Pham, "A new approach to time-optimal path parameterization based on reachability analysis", IEEE
   Transactions on Robotics, 2018. Its two-variable linear programs are solved here by elimination in closed form.
2. Departure: the limits must hold for the motion as it is played, with constant velocity between waypoints and jumps
   of velocity at them. That is not the curve of the passes, so they are repeated with tighter limits where the played
   motion exceeds them; a common factor on all times covers the rest, and the result keeps the limits to rounding.

The library toppra solves step 1 for splines through the waypoints. Played with constant velocities, its timings of
eight planned motions exceeded the acceleration limits by 2 to 105 %, so step 2 would be needed around it as well.
"""

import numpy as np

Limits = float | np.ndarray

_SHORTEST = 1e-6  # step [s]: keeps times increasing where a posture is repeated
_ROUNDS = 12  # tightened passes; plans that minimize torque alone, the roughest motions tried, take all of them
_CLOSE = 1.002  # a played motion that exceeds its limits by no more is stretched instead


def fastest_times(q: np.ndarray, velocity: Limits, acceleration: Limits) -> np.ndarray:
    """Return the times at which waypoints are played fastest, from rest to rest.

    Args:
        q: Joint angles without jumps of a full turn, ``(K, joint)`` [rad].
        velocity: Largest joint speeds between waypoints, a number or ``(joint,)`` [rad/s].
        acceleration: Largest joint accelerations, a number or ``(joint,)`` [rad/s²]: the change of speed at a waypoint
            over half of the steps beside it (see :func:`played_acceleration`).

    Returns:
        Increasing times from 0 on, ``(K,)`` [s].

    Raises:
        ValueError: A limit is not positive, or not one per joint.
    """
    joints = q.shape[1]
    velocity, acceleration = (
        _limit(name, value, joints) for name, value in (("velocity", velocity), ("acceleration", acceleration))
    )
    motion = np.diff(q, axis=0)
    if not len(motion):
        return np.zeros(len(q))
    step = np.maximum((np.abs(motion) / velocity).max(axis=1), _SHORTEST)
    slope, bend = _derivatives(motion / step[:, None], step)
    allowed = np.ones(len(q))  # fraction of the acceleration limits at every waypoint
    best = np.full(len(motion), np.inf)
    for _ in range(_ROUNDS):
        duration = _passes(motion, slope, bend, acceleration * allowed[:, None], step)
        excess = (np.abs(played_acceleration(q, duration)) / acceleration).max(axis=1)
        stretched = duration * max(1.0, np.sqrt(excess.max()))
        if stretched.sum() < best.sum():
            best = stretched
        if excess.max() < _CLOSE:
            break
        # The velocities around a waypoint are also those around its neighbors: tighten all three.
        near = np.maximum(excess, np.maximum(np.append(excess[1:], 0), np.append(0, excess[:-1])))
        allowed = allowed / np.maximum(1.0, near)
    return np.append(0.0, np.cumsum(best))


def played_acceleration(q: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Return the accelerations of a motion played from rest to rest with constant velocities between waypoints.

    The acceleration at a waypoint is the change of velocity over half of the steps beside it.

    Args:
        q: Joint angles, ``(K, joint)`` [rad].
        duration: Durations of the steps, ``(K - 1,)`` [s].

    Returns:
        Accelerations, ``(K, joint)`` [rad/s²].
    """
    speed = np.diff(q, axis=0) / duration[:, None]
    return np.diff(speed, axis=0, prepend=0, append=0) / _half_steps(duration)[:, None]


def _passes(motion: np.ndarray, slope: np.ndarray, bend: np.ndarray, limit: np.ndarray, step: np.ndarray) -> np.ndarray:
    """Return the steps' durations on the fastest curve from rest to rest with |slope u + bend x| <= limit and x <= 1.

    u is d²s/dt², x is (ds/dt)².
    """
    count = len(step)
    reach = np.ones(count + 1)  # largest x from which the end can be reached
    reach[0] = reach[-1] = 0.0
    for k in reversed(range(1, count)):
        reach[k] = min(1.0, _largest_before(slope[k], bend[k], limit[k], step[k], reach[k + 1]))
    x = np.zeros(count + 1)
    for k in range(count):
        room, drift = _next(slope[k], bend[k], limit[k], step[k])
        x[k + 1] = np.clip((drift * x[k] + room).min(), 0.0, reach[k + 1])
    # No step takes longer than one with a stop at both ends; at a stop, or by rounding, the curve may have no speed.
    lowest = np.minimum(limit[1:], limit[:-1])
    stopping = np.sqrt(2 * (np.abs(motion) / lowest).max(axis=1))
    curve = 2 * step / np.maximum(np.sqrt(x[1:]) + np.sqrt(x[:-1]), np.finfo(float).tiny)
    return np.maximum(step, np.minimum(curve, stopping))


def _largest_before(slope: np.ndarray, bend: np.ndarray, limit: np.ndarray, step: float, reach: float) -> float:
    """Return the largest x that some next x in [0, reach] may follow, by elimination of the next x."""
    half, drift = _next(slope, bend, limit, step)
    low, high, drift = np.append(-half, 0.0), np.append(half, reach), np.append(drift, 0.0)
    room = high[None, :] - low[:, None]  # one bound per pair, never negative since rest may follow rest
    rate = drift[:, None] - drift[None, :]
    return float(np.divide(room, rate, out=np.full(rate.shape, np.inf), where=rate > 0).min())


def _next(slope: np.ndarray, bend: np.ndarray, limit: np.ndarray, step: float) -> tuple[np.ndarray, ...]:
    """Return room and drift of every joint's bounds on the next x: |next - drift x| <= room."""
    # A joint that does not move along the path bounds only x itself, as with a slope this small.
    slope = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
    return 2 * step * limit / np.abs(slope), 1 - 2 * step * bend / slope


def _derivatives(speed: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return dq/ds and d²q/ds² at the waypoints, from the velocities of the steps."""
    if len(step) == 1:
        return np.concatenate([speed, speed]), np.zeros((2, speed.shape[1]))
    inner = np.diff(speed, axis=0) / _half_steps(step)[1:-1, None]
    bend = np.concatenate([inner[:1], inner, inner[-1:]])
    half = step[:, None] / 2
    return np.concatenate([speed - bend[:-1] * half, speed[-1:] + bend[-1:] * half[-1:]]), bend


def _half_steps(duration: np.ndarray) -> np.ndarray:
    """Return half of the step before plus half of the step after every waypoint."""
    return (np.append(duration, 0.0) + np.append(0.0, duration)) / 2


def _limit(name: str, value: Limits, joints: int) -> np.ndarray:
    limit = np.asarray(value, np.float64)
    if limit.shape not in ((), (joints,)):
        raise ValueError(f"{name} needs a number or one per joint, ({joints},); got shape {limit.shape}")
    if not (limit > 0).all():
        raise ValueError(f"{name} limits need to be above 0; got {limit.tolist()}")
    return np.broadcast_to(limit, (joints,))
