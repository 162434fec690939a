"""``python -m jaxik.paper``: print the table, computed in float64."""

import jax

from jaxik.paper.report import table

if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)  # a program may set this, a library must not
    print(table())
