"""One file per question; each prints a table. Run with ``python -m benchmarks.NAME``."""
