"""The machine that a run has: memory, threads, processes, and the counter of work."""
