"""``python -m jaxik.paper``: the table, in float64."""

import jax

from jaxik.paper.report import table

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)  # a program's choice, which the library itself never makes
    print(table())
