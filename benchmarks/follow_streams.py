"""Does follow ever step too far, leave a limit, give NaN, or miss a target that is within the step?

Streams of targets at 1 kHz, one per row, of eleven kinds: random walks of the joints, smooth motions to the very
limits, the same with 0.5 mm of noise, jumps, spins of the hand by 2 pi in place, the elbow through straight, shoulder
and wrist through their alignments and at rest there, in and out of reach, NaN frames, dropped frames, and a hand that
moves without turning. Counted are, over all steps: joint steps above the speeds (and accelerations, with
``--acceleration``), joints outside limits, and numbers that are not finite. Some steps that are not on target are
compared with a follower by brute force: a dense sample of the whole self-motion, every branch and split, in the box
that the joints can reach.

Run: ``python -m benchmarks.follow_streams --steps 10000000``; the last line says what was counted.
"""

import argparse
import sys
import time
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
from jaxik import FollowStatus
from tests.helpers.arms import ALL_PRESETS

DT = 1e-3
KINDS = ("walk", "limits", "noise", "jumps", "spin", "straight", "aligned", "reach", "NaN", "dropped", "hand")
LOST = 0.05  # part of the frames that are NaN


class Streams:
    """Targets of rows, chunk by chunk."""

    def __init__(self, arm: jaxik.Arm, rows: int, seed: int) -> None:
        self.arm, self.rng, self.kind = arm, np.random.default_rng(seed), np.arange(rows) % len(KINDS)
        self.low, self.high = np.maximum(arm.lower, -3.0), np.minimum(arm.upper, 3.0)
        self.speed = np.minimum(np.asarray(arm.velocity_limit), 10.0)
        self.phase = self.rng.uniform(0, 2 * np.pi, (rows, arm.n_joints))
        half = 0.5 * (self.high - self.low)
        self.rate = self.rng.uniform(-1.0, 1.0, self.phase.shape) * self.speed / half
        self.at = self.rng.uniform(self.low, self.high, self.phase.shape)  # of the random walks
        self.time = 0
        self.hand = jax.jit(partial(jaxik.forward_kinematics, arm))

    def start(self) -> np.ndarray:
        """Present postures at the beginning: on target, or anywhere."""
        q = self.rng.uniform(self.low, self.high, self.phase.shape)
        on = self.rng.uniform(size=len(q)) < 0.7
        return np.where(on[:, None], self.joints(1)[0], q)

    def joints(self, steps: int) -> np.ndarray:
        """Joint angles of the streams, ``(steps, rows, joint)``."""
        t = DT * (self.time + np.arange(steps))[:, None, None]
        middle, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        q = middle + half * np.sin(self.phase + self.rate * t)
        walks = self.kind == KINDS.index("walk")
        pushed = self.rng.normal(size=(steps, walks.sum(), q.shape[2])) * self.speed * DT * 0.4
        folded = np.abs((self.at[walks] + np.cumsum(pushed, axis=0) - self.low) % (4 * half) - 2 * half)
        q[:, walks] = self.high - folded
        self.at[walks] = q[-1, walks]
        jumps = self.kind == KINDS.index("jumps")
        corner = 300 * ((self.time + np.arange(steps)) // 300)[:, None, None] * DT
        q[:, jumps] = middle + half * np.sin(self.phase[jumps] * (1.0 + corner))
        straight, aligned = self.kind == KINDS.index("straight"), self.kind == KINDS.index("aligned")
        q[:, straight, 3] = np.clip(0.5 * np.sin(2.0 * t[..., 0] + self.phase[straight, 3]), self.low[3], self.high[3])
        for joint in (1, 5):  # through zero, and at rest there a third of the time
            swing = 0.5 * np.sin(2.0 * t[..., 0] + self.phase[aligned, joint])
            q[:, aligned, joint] = np.sign(swing) * np.maximum(np.abs(swing) - 0.25, 0.0)
        still = np.isin(self.kind, [KINDS.index("spin"), KINDS.index("hand")])
        q[:, still] = (middle + 0.7 * half * np.sin(self.phase))[still]
        return np.clip(q, self.low, self.high)

    def chunk(self, steps: int) -> jaxik.Pose:
        """The next targets, ``(steps, rows)``."""
        t, rng = DT * (self.time + np.arange(steps))[:, None], self.rng
        pose = self.hand(self.joints(steps))
        position, rotation = np.array(pose.position), np.array(pose.rotation)
        is_kind = {name: self.kind == i for i, name in enumerate(KINDS)}
        noisy = is_kind["noise"]
        position[:, noisy] += 5e-4 * rng.normal(size=position[:, noisy].shape)
        rows = is_kind["spin"]
        angle = 2 * np.pi * np.sin(0.7 * t + self.phase[rows, 0])
        turn = np.zeros((*angle.shape, 3, 3))
        turn[..., 0, 0] = turn[..., 1, 1] = np.cos(angle)
        turn[..., 1, 0], turn[..., 0, 1], turn[..., 2, 2] = np.sin(angle), -np.sin(angle), 1.0
        rotation[:, rows] = rotation[:, rows] @ turn
        rows = is_kind["reach"]
        position[:, rows] *= (1 + 0.6 * np.sin(1.5 * t + self.phase[rows, 0]))[..., None]
        rows = is_kind["hand"]
        way = np.stack([0.25 * np.sin(w * t + self.phase[rows, i]) for i, w in enumerate((0.9, 1.1, 1.3))], axis=-1)
        position[:, rows] += way
        lost = is_kind["NaN"] & (rng.uniform(size=(steps, len(self.kind))) < LOST)
        position[lost] = np.nan
        dropped = is_kind["dropped"] & (rng.uniform(size=(steps, len(self.kind))) < 0.5)
        dropped[0] = False
        last = np.maximum.accumulate(np.where(dropped, 0, np.arange(steps)[:, None]), axis=0)
        self.time += steps
        at = last, np.arange(len(self.kind))
        return jaxik.Pose(jnp.asarray(position[at]), jnp.asarray(rotation[at]))


def run_streams(arm: jaxik.Arm, acceleration: float | None) -> Any:
    """Return a compiled function from the last step and targets to all steps."""

    @jax.jit
    def run(last: jaxik.FollowStep, target: jaxik.Pose) -> Any:
        def step(last: jaxik.FollowStep, target: jaxik.Pose) -> Any:
            more = {} if acceleration is None else {"acceleration": acceleration, "last": last}
            found = jaxik.follow(arm, target, last.q, DT, **more)
            return found, (last.q, last.velocity, found)

        return jax.lax.scan(step, last, target)

    return run


def broken(arm: jaxik.Arm, before: Any, velocity: Any, found: Any, acceleration: float | None) -> np.ndarray:
    """Count joint steps above speeds and accelerations, joints outside limits, and numbers that are not finite."""
    q, before, velocity = np.asarray(found.q), np.asarray(before), np.asarray(velocity)
    low, high, most = (np.asarray(x) for x in (arm.lower, arm.upper, arm.velocity_limit))
    fast = np.abs(q - before) > most * DT * (1 + 1e-9)
    change = np.abs((q - before) / DT - velocity)
    hard = np.zeros(1) if acceleration is None else change > acceleration * DT * (1 + 1e-9) + 1e-9
    return np.array([fast.sum(), hard.sum(), ((q < low) | (q > high)).sum(), (~np.isfinite(q)).sum()])


def reachable(arm: jaxik.Arm, target: jaxik.Pose, low: np.ndarray, high: np.ndarray, near: float) -> bool:
    """Test by a dense sample of swivels, branches and splits whether a box holds a posture on target."""
    around = near + np.linspace(-0.06, 0.06, 6001)  # a step turns the elbow by less, unless next to singularities
    swivel = np.concatenate([around, np.linspace(-np.pi, np.pi, 6000)])
    solution = _solved(arm, target, swivel)
    q, ok = np.asarray(solution.q), np.asarray(solution.status) < jaxik.Status.KEEP_OUT
    middle = 0.5 * (low + high)
    q = q + 2 * np.pi * np.round((middle - q) / (2 * np.pi))
    fits = (q >= low) & (q <= high)
    for first in (0, 4):  # an aligned joint: any split of its turn
        aligned = np.abs(np.sin(q[..., first + 1])) < 1e-9
        sign = np.where(np.cos(q[..., first + 1]) > 0, 1.0, -1.0)
        turn = q[..., first] + sign * q[..., first + 2]
        center = middle[first] + sign * middle[first + 2]
        off = np.abs((turn - center + np.pi) % (2 * np.pi) - np.pi)
        split = off <= 0.5 * (high - low)[[first, first + 2]].sum()
        for joint in (first, first + 2):
            fits[..., joint] = np.where(aligned, split, fits[..., joint])
    return bool((fits.all(axis=-1) & ok).any())


_solved = jax.jit(lambda arm, target, swivel: jaxik.solve_ik(arm, target, swivel))


def missed(arm: jaxik.Arm, before: Any, target: jaxik.Pose, found: Any, count: int, rng: np.random.Generator) -> int:
    """Count steps not on target, of ``count`` sampled ones without accelerations, that had a posture on target."""
    status, q = np.asarray(found.status), np.asarray(before)
    late = np.argwhere((status == FollowStatus.LAGGING) | (status == FollowStatus.INFEASIBLE))
    after = np.array([k > 0 and status[k - 1, row] == FollowStatus.ON_TARGET for k, row in late], bool)
    just = late[after]  # on target a step before: the ones that are close
    picked = [x[rng.permutation(len(x))[: -(-count // 2)]] for x in (just, late)]
    misses = 0
    for k, row in np.concatenate(picked)[:count]:
        now, room = q[k, row], np.asarray(arm.velocity_limit) * DT
        low, high = np.maximum(arm.lower, now - room), np.minimum(arm.upper, now + room)
        pose = jax.tree.map(lambda x, k=k, row=row: jnp.asarray(x[k, row]), target)
        misses += reachable(arm, pose, low, high, float(_swivel_of(arm, now)))
    return misses


_swivel_of = jax.jit(lambda arm, q: jaxik.swivel_of(arm, q).swivel)


def main() -> None:
    """Run the streams and print what was counted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--rows", type=int, default=512, help="streams at once")
    parser.add_argument("--chunk", type=int, default=250, help="steps of a stream at once")
    parser.add_argument("--arm", default="iiwa7", choices=sorted(ALL_PRESETS))
    parser.add_argument("--acceleration", type=float, help="of every joint [rad/s²]")
    parser.add_argument("--brute", type=int, default=100, help="steps compared with a follower by brute force")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=1e9, help="stop after a chunk when so much time has passed")
    options = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    arm = ALL_PRESETS[options.arm]().arm
    streams, began, rng = Streams(arm, options.rows, options.seed), time.perf_counter(), np.random.default_rng(1)
    run, last = run_streams(arm, options.acceleration), jaxik.FollowStep.at_rest(jnp.asarray(streams.start()))
    done, counts = 0, np.zeros(4, int)
    statuses, misses, compared, hard_ends = np.zeros((len(KINDS), len(FollowStatus)), int), 0, 0, 0
    while done < options.steps and time.perf_counter() - began < 60 * options.minutes:
        target = streams.chunk(options.chunk)
        last, (before, speed, found) = run(last, target)
        counts = counts + broken(arm, before, speed, found, options.acceleration).astype(int)
        hard_ends += stops_at_limits(arm, found)
        for kind in range(len(KINDS)):
            seen = np.asarray(found.status)[:, streams.kind == kind].ravel()
            statuses[kind] += np.bincount(seen, minlength=len(FollowStatus))
        done += options.rows * options.chunk
        if options.acceleration is None and compared < options.brute:
            size = min(options.brute - compared, 20)
            misses, compared = misses + missed(arm, before, target, found, size, rng), compared + size
    print(f"{'kind':<10}" + "".join(f"{s.name.lower():>12}" for s in FollowStatus))
    for name, row in zip(KINDS, statuses, strict=True):
        print(f"{name:<10}" + "".join(f"{x:>12}" for x in row))
    fast, hard, outside, nonfinite = counts
    print(f"{hard_ends} stops of a joint at its limit from more than half of its speed")
    print(
        f"{options.arm}, {done} steps in {time.perf_counter() - began:.0f} s: {fast} above speeds, {hard} above "
        f"accelerations, {outside} outside limits, {nonfinite} not finite; {misses} of {compared} steps off target had "
        "a posture on target within the step"
    )
    sys.exit(bool(counts.any() or misses))


def stops_at_limits(arm: jaxik.Arm, found: Any) -> int:
    """Count joints that come to rest on a limit after a step of more than half of their speed."""
    q, velocity = np.asarray(found.q), np.asarray(found.velocity)
    there = (q[1:-1] <= arm.lower) | (q[1:-1] >= arm.upper)
    fast = np.abs(velocity[1:-1]) > 0.5 * np.asarray(arm.velocity_limit)
    return int((there & fast).sum())


if __name__ == "__main__":
    main()
