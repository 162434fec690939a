"""The package ``training`` under a name that no folder of a user can take; loaded when it is imported."""

from jaxik.beside import adopt

adopt(__name__)
