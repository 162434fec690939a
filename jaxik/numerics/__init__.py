"""Building blocks of the kernels: elementary functions, angles, vectors and batches with the batch last."""

from jaxik.numerics import vec3
from jaxik.numerics.angles import principal, shortest, toward, unwrap, wrap
from jaxik.numerics.batch_layout import merge_leading, to_batch_first, to_batch_last
from jaxik.numerics.chunks import CHUNK, at_hand, cores, in_chunks, map_chunks, on_one_cpu
from jaxik.numerics.compiling import compiled_sooner
from jaxik.numerics.elementary import arctan2, clipped_sqrt, sincos, sincos_apart, unit_sqrt, with_value
from jaxik.numerics.fusion import fused_separately
from jaxik.numerics.sorting import sort_columns
from jaxik.numerics.tolerances import Tolerances, tolerances

__all__ = [
    "CHUNK",
    "Tolerances",
    "arctan2",
    "at_hand",
    "clipped_sqrt",
    "compiled_sooner",
    "cores",
    "fused_separately",
    "in_chunks",
    "map_chunks",
    "merge_leading",
    "on_one_cpu",
    "principal",
    "shortest",
    "sincos",
    "sincos_apart",
    "sort_columns",
    "to_batch_first",
    "to_batch_last",
    "tolerances",
    "toward",
    "unit_sqrt",
    "unwrap",
    "vec3",
    "with_value",
    "wrap",
]
