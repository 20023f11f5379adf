"""Which block to build: what matters (`sensitivity`), and the best design (`search`)."""
