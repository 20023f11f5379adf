"""Robustness cases, each with the law that must hold and the numbers that show whether it does."""
