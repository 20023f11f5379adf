"""Other programs on the same problems, each where it is installed."""
