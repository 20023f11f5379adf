"""Benchmarks: what the solvers cost, measured against what the machine can do."""
