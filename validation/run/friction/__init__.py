"""What friction does to a run: which blocks it holds, where they slide, how wide its answer is."""
