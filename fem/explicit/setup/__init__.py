"""From an assembly to the model of an explicit run."""
