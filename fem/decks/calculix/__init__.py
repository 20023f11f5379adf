"""Decks for CalculiX."""
