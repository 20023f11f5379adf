"""Order of assembly: which block comes out, whether each stage stands, what must be propped."""
