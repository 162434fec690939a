"""Certificates of global optimality: a lower bound by interval dynamic programming, in the manner of branch and bound.

Follow it from :mod:`proof` (which waypoints, from which incumbent) to :mod:`bound` (dynamic programming, excluding,
halving), :mod:`steps` (least cost of a step between two cells), :mod:`cells` (enclosures on a piece of swivel) and
:mod:`quadratic` (least values in closed form).
"""

from jaxik.planning.certificate.proof import certify

__all__ = ["certify"]
