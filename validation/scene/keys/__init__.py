"""Keys of scenes: their units, ranges, documentation and JSON schema."""
