"""Static runs with curved elements: solved on one mesh, from coarse to fine, and their fields."""
