"""Building blocks of the kernels: differentiable elementary functions, angles, vectors with the batch last."""

from jaxik.numerics import vec3
from jaxik.numerics.angles import wrap
from jaxik.numerics.batch_layout import merge_leading, to_batch_first, to_batch_last
from jaxik.numerics.elementary import arctan2, clipped_sqrt, sincos, unit_sqrt
from jaxik.numerics.fusion import fused_separately
from jaxik.numerics.sorting import sort_columns
from jaxik.numerics.tolerances import Tolerances, tolerances

__all__ = [
    "Tolerances",
    "arctan2",
    "clipped_sqrt",
    "fused_separately",
    "merge_leading",
    "sincos",
    "sort_columns",
    "to_batch_first",
    "to_batch_last",
    "tolerances",
    "unit_sqrt",
    "vec3",
    "wrap",
]
