"""Measurements of the whole; `python -m benchmarks FILE` writes them all into one page."""
