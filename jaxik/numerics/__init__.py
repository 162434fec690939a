"""Building blocks of the kernels: elementary functions, angles, vectors and batches with the batch last."""

from jaxik.numerics import vec3
from jaxik.numerics.angles import principal, shortest, toward, unwrap, wrap
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
    "principal",
    "shortest",
    "sincos",
    "sort_columns",
    "to_batch_first",
    "to_batch_last",
    "tolerances",
    "toward",
    "unit_sqrt",
    "unwrap",
    "vec3",
    "wrap",
]
