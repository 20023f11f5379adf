"""Decks read back."""
