"""An environment with hundreds of arms in one program: python examples/arm_environments.py [NUMBER OF ARMS].

Each arm has link lengths of its own and a goal for its tool. An action is a wish for the next step, from -1 to 1: the
direction in which the tool moves, and how the elbow turns. The closed form makes a posture of it, and the joints follow
within their limits of angle and velocity. Everything is a function of arrays: ``jax.vmap`` maps over arms and
``jax.lax.scan`` over time, and rewards have derivatives in actions, goals and link lengths.
"""

import dataclasses
import sys
import time

import jax
import jax.numpy as jnp

import jaxik

MODEL = jaxik.presets.iiwa14()
HOME = jnp.radians(jnp.array([0.0, 30.0, 0.0, -90.0, 0.0, 60.0, 0.0]))
BRANCH = int(jaxik.swivel_of(MODEL.arm, HOME).branch)
ROTATION = jaxik.forward_kinematics(MODEL.arm, HOME).rotation  # of the tool, which keeps it, whatever the lengths
DT = 0.05  # s
SPEED = jnp.array([0.4, 0.4, 0.4, 1.0])  # of an action of 1: tool [m/s], elbow [rad/s]


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class State:
    """One arm and its goal; a leading axis on every array holds many.

    Attributes:
        arm: The arm.
        q: Joint angles, ``(7,)`` [rad].
        swivel: Place of the elbow that is wished for [rad].
        goal: Where the tool should be, ``(3,)`` [m].
        tool: The tool's pose.
    """

    arm: jaxik.Arm
    q: jax.Array
    swivel: jax.Array
    goal: jax.Array
    tool: jaxik.Pose


def reset(key: jax.Array) -> State:
    """Return an arm at its home posture, its links up to 10 % longer or shorter, with a goal some 20 cm away.

    Args:
        key: Random key.
    """
    lengths, away = jax.random.split(key)
    scale = jax.random.uniform(lengths, (3,), minval=0.9, maxval=1.1)
    arm = MODEL.arm
    upper_arm, forearm = scale[0] * (arm.elbow - arm.shoulder), scale[1] * (arm.wrist - arm.elbow)
    hand = scale[2] * (arm.tool_position - arm.wrist)
    elbow = arm.shoulder + upper_arm
    wrist = elbow + forearm
    arm = dataclasses.replace(arm, elbow=elbow, wrist=wrist, tool_position=wrist + hand)
    tool = jaxik.forward_kinematics(arm, HOME)
    goal = tool.position + jax.random.uniform(away, (3,), minval=-0.2, maxval=0.2)
    return State(arm, HOME, jaxik.swivel_of(arm, HOME).swivel, goal, tool)


def observe(state: State) -> jax.Array:
    """Return what a policy sees, ``(11,)``: the way to the goal [m], the place of the elbow and the joint angles [rad].

    Args:
        state: One arm.
    """
    return jnp.concatenate([state.goal - state.tool.position, state.swivel[None], state.q])


def step(state: State, action: jax.Array) -> tuple[State, jax.Array]:
    """Move one arm for one step.

    Args:
        state: The arm.
        action: Direction of the tool and turn of the elbow, ``(4,)``, from -1 to 1.

    Returns:
        The arm afterwards, and the reward: minus the distance to the goal [m], less where a joint holds the arm back.
    """
    arm, wish = state.arm, DT * SPEED * jnp.clip(action, -1, 1)
    target = jaxik.Pose(state.tool.position + wish[:3], ROTATION)
    wanted = jaxik.solve_ik(arm, target, state.swivel + wish[3]).q[BRANCH]
    way = jnp.clip(wanted, arm.lower, arm.upper) - state.q
    fastest = DT * arm.velocity_limit
    share = jnp.minimum(1.0, jnp.min(fastest / jnp.maximum(jnp.abs(way), 1e-9)))  # all joints arrive together
    q = state.q + share * way
    tool = jaxik.forward_kinematics(arm, q)
    reward = -jnp.linalg.norm(state.goal - tool.position) - 0.1 * (1 - share)
    return State(arm, q, state.swivel + share * wish[3], state.goal, tool), reward


def rollout(policy, keys: jax.Array, steps: int = 40) -> tuple[State, jax.Array]:
    """Play one episode with many arms at once.

    Args:
        policy: Function of an observation that returns an action.
        keys: Random keys, one per arm.
        steps: Length of the episode.

    Returns:
        The arms at the end, and the rewards, ``(step, arm)``.
    """

    def frame(states: State, _: None) -> tuple[State, jax.Array]:
        return jax.vmap(step)(states, jax.vmap(lambda state: policy(observe(state)))(states))

    return jax.lax.scan(frame, jax.vmap(reset)(keys), None, length=steps)


def toward_the_goal(observation: jax.Array) -> jax.Array:
    """Return the action of a policy that goes toward the goal and leaves the elbow alone.

    Args:
        observation: What it sees.
    """
    return jnp.concatenate([observation[:3] / (DT * SPEED[:3]), jnp.zeros(1)])


def main(arms: int) -> None:
    """Play with many arms and print what comes of it.

    Args:
        arms: Their number.
    """
    keys = jax.random.split(jax.random.key(0), arms)
    play = jax.jit(lambda keys: rollout(toward_the_goal, keys))
    for name in ("first", "second"):
        began = time.perf_counter()
        _, rewards = jax.block_until_ready(play(keys))
        took = time.perf_counter() - began
        print(f"{name} episode: {arms} arms, {len(rewards)} steps, {took:.2f} s, {rewards.size / took:.0f} steps/s")
    distance = -rewards
    print(f"mean distance to the goal: {distance[0].mean():.3f} m at first, {distance[-1].mean():.4f} m at last")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 512)
