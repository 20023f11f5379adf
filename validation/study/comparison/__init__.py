"""Answers beside each other: methods, other programs, closed forms."""
