"""First calls: time to trace and to compile, and operations of the compiled programs.

python -m benchmarks.compile [CALL ...]

Each call runs in a process of its own with an empty cache, on one pose or on a straight path of 201 waypoints; a second
process counts the operations after optimization, those within fusions included. CPU time: a busy machine matters less.
"""

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

import jaxik
from benchmarks.common import table

jax.config.update("jax_enable_x64", True)


def calls() -> dict[str, Callable[[], object]]:
    """Return the public calls by name, each ready to be made for the first time."""
    model = jaxik.presets.iiwa14()
    arm, q = model.arm, jnp.linspace(-0.9, 0.9, 7)
    target, swivel = jaxik.Pose(jnp.array([0.5, 0.1, 0.6]), jnp.eye(3)), jnp.asarray(0.3)
    line = np.linspace([0.5, -0.15, 0.5], [0.5, 0.15, 0.6], 201)
    path = jaxik.Path(jaxik.Pose(line, np.tile(np.diag([1.0, -1.0, -1.0]), (201, 1, 1))), np.linspace(0.0, 4.0, 201))

    def square(target: jaxik.Pose, swivel: jax.Array) -> jax.Array:
        return jnp.sum(jaxik.solve_ik(arm, target, swivel).q ** 2)

    def near(target: jaxik.Pose) -> jax.Array:
        return jnp.sum(jaxik.solve_nearest(arm, target, q).q ** 2)

    return {
        "forward_kinematics": lambda: jaxik.forward_kinematics(arm, q),
        "solve_ik": lambda: jaxik.solve_ik(arm, target, swivel).q,
        "its residual": lambda: jaxik.solve_ik(arm, target, swivel),
        "gradient of solve_ik": lambda: jax.jit(jax.grad(square, (0, 1)))(target, swivel),
        "swivel_of": lambda: jaxik.swivel_of(arm, q),
        "swivel_arcs": lambda: jaxik.swivel_arcs(arm, target),
        "solve_nearest": lambda: jaxik.solve_nearest(arm, target, q),
        "gradient of solve_nearest": lambda: jax.jit(jax.grad(near))(target),
        "jacobian": lambda: jaxik.jacobian(arm, q),
        "gravity_torque": lambda: jaxik.gravity_torque(arm, q),
        "fit_path": lambda: jaxik.fit_path(arm, jaxik.example_path("wave")),
        "plan": lambda: jaxik.plan(arm, path, gap=None),
        "plan with proof": lambda: jaxik.plan(arm, path),
    }


def first_call(name: str) -> None:
    """Make one call and print its wall, CPU, tracing and compile time [s]."""
    call = calls()[name]
    spent = {"trace": 0.0, "lower": 0.0, "compile": 0.0}
    events = {"jaxpr_trace": "trace", "jaxpr_to_mlir": "lower", "backend_compile": "compile"}

    def listen(event: str, duration_secs: float, **_: str | int) -> None:
        for part, phase in events.items():
            if part in event:
                spent[phase] += duration_secs

    jax.monitoring.register_event_duration_secs_listener(listen)
    wall, cpu = time.perf_counter(), time.process_time()
    jax.block_until_ready(call())
    print(time.perf_counter() - wall, time.process_time() - cpu, *spent.values())


def measured(name: str) -> tuple[object, ...]:
    """Return a row of the table: times from one process, operations from another."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("JAX_")}
    command = [sys.executable, "-m", "benchmarks.compile", "--one", name]
    run = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    wall, cpu, *phases = map(float, run.stdout.split())
    with tempfile.TemporaryDirectory() as folder:
        environment["XLA_FLAGS"] = f"{environment.get('XLA_FLAGS', '')} --xla_dump_to={folder} --xla_dump_hlo_as_text"
        subprocess.run(command, env=environment, capture_output=True, check=True)
        programs = [p.read_text() for p in Path(folder).glob("*cpu_after_optimizations.txt")]
    operations = sum(len(re.findall(r"^\s+(?:ROOT )?%?[\w.-]+ = ", text, re.MULTILINE)) for text in programs)
    return name, f"{wall:.2f}", f"{cpu:.2f}", *(f"{p:.2f}" for p in phases), len(programs), operations


def main() -> None:
    if sys.argv[1:2] == ["--one"]:
        first_call(sys.argv[2])
        return
    rows = [measured(name) for name in sys.argv[1:] or calls()]
    header = ("call", "first call", "CPU", "tracing", "lowering", "compiling", "programs", "operations")
    table("First calls with an empty cache, iiwa14, float64 [s]", header, rows)


if __name__ == "__main__":
    main()
