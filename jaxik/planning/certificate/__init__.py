"""How good the best motion can be at all: a lower bound by interval dynamic programming.

Follow it from :mod:`proof` (which waypoints, what from) to :mod:`bound` (dynamic programming, excluding, halving),
:mod:`steps` (what a step between two cells costs at least), :mod:`cells` (what holds on a piece of swivel) and
:mod:`quadratic` (least values in closed form).
"""

from jaxik.planning.certificate.proof import certify

__all__ = ["certify"]
