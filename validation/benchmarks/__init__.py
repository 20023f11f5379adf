"""Benchmarks: CPU seconds and ratios measured in one run. They are never tests."""
