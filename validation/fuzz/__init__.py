"""The command line against random input."""
