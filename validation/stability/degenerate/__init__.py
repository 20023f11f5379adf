"""Contact at edges, corners and facets of very different size."""
