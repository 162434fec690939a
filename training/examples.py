"""What a training learns from: rows made from their numbers, divided among devices.

A row has a number in an endless list and is made where it is used, by one program for training, validation and all
else. So memory does not grow with what has been seen, and devices only divide the rows among themselves.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import jax
import numpy as np
from jax import Array
from jax.sharding import Mesh, NamedSharding, PartitionSpec

AXIS = "data"
_GROUPS = 16  # of a batch, one after the other


def data_mesh(devices: Sequence[Any] | None = None) -> Mesh:
    """A mesh whose one axis divides the rows of a batch.

    Args:
        devices: The devices; None for all of all processes.

    Returns:
        The mesh.
    """
    return Mesh(np.array(jax.devices() if devices is None else devices), (AXIS,))


class Examples:
    """Makes examples from row numbers.

    Rows are worked on in groups whose number depends on the batch alone, one after the other. So the devices do not
    change what is rounded where: in single precision Adam, which divides small gradients by their own size, would make
    another training of it within a few steps.

    Args:
        make: Of row numbers ``(n,)``, any pytree of arrays; nothing that training changes may go in.
        mesh: Devices that share the rows, see :func:`data_mesh`; None for the first of this process.
    """

    def __init__(self, make: Callable[[Array], Any], mesh: Mesh | None = None) -> None:
        self.mesh = data_mesh(jax.local_devices()[:1]) if mesh is None else mesh
        divided = PartitionSpec(AXIS)

        @jax.jit
        @partial(jax.shard_map, mesh=self.mesh, in_specs=divided, out_specs=divided, check_vma=False)
        def made(groups: Array) -> Any:
            return jax.lax.map(make, groups)

        self._made = made

    def __call__(self, first: int, count: int) -> Any:
        """Examples of the rows from ``first`` on, groups along the first axis.

        Args:
            first: Number of the first row.
            count: How many rows, a multiple of the number of devices.
        """
        devices = self.mesh.size
        groups = next(n for n in (_GROUPS, devices) if count % n == 0 and n % devices == 0)
        numbers = np.arange(first, first + count, dtype=np.int32).reshape(groups, -1)
        sharding = NamedSharding(self.mesh, PartitionSpec(AXIS))
        return self._made(jax.make_array_from_callback(numbers.shape, sharding, lambda part: numbers[part]))
