"""Contact in the explicit loop: facets that stay paired, facets that a search finds."""
