"""Scenes, the paper, comparisons, cost, stability and the command line."""
