"""Search and refinement in joint space: for arms of any class whose postures at a redundancy parameter can be had."""
