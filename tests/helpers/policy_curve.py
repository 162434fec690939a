"""A short training of the elbow policy, for comparing its curve on several sets of devices."""

import jax
import numpy as np

import jaxik
from training.examples import data_mesh
from training.loop import LoopConfig
from training.policy.training import PolicyConfig, train


def curve(everything: bool) -> np.ndarray:
    """Training losses on all devices of all processes, or on this process's first."""
    loop = LoopConfig(steps=8, batch=16, validate_every=8)
    config = PolicyConfig(width=8, loop=loop, plans=0, validation_rows=16)
    mesh = data_mesh() if everything else data_mesh(jax.local_devices()[:1])
    return train(config, arm=jaxik.presets.iiwa14(), mesh=mesh).by_energy.losses
